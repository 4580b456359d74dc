"""Watches on one drive: its heartbeat (CiA 301), and whether it stops when it is told to.

A drive may send all that it should and yet not hear us: its RPDO was disabled or mapped anew, its
program has come to grief. It goes on at its last velocity while our heartbeat tells it that all is
well. What it does not do about a setpoint it may still do about an NMT stop, which counts as a loss
of the connection (0x6007). If that does not help either, only our silence is left.

Time is an argument.
"""

from dataclasses import dataclass
from typing import Final

from drivers.cia402 import DriveState, PowerTarget
from drivers.events import Disobedient, HeartbeatLost, NotOperational, Rebooted, Unstoppable
from drivers.ids import BOOT_UP, OPERATIONAL

#: Heartbeats that may go missing.
HEARTBEATS_MISSED: Final = 3
#: How long a drive may stay in operation after it was told otherwise [s]. It needs two ticks to
#: quick-stop and to say so; to switch off it may wait for its brake.
PATIENCE_S: Final = {PowerTarget.QUICK_STOP: 0.05, PowerTarget.OFF: 1.0}
#: And so many samples must have said so, however late they came.
PATIENCE_TICKS: Final = 5


@dataclass(slots=True)
class HeartbeatWatch:
    """Tells the loss of a heartbeat, and a drive that stops being operational, once each.

    Made when the drive has just been told to be operational, at `heard_at`.
    """

    node: int
    timeout_s: float
    heard_at: float
    lost: bool = False
    # Heartbeats of before NMT start may still be under way after it: no longer being operational
    # is news only of a drive that was heard to be.
    operational: bool = False
    # It has left NMT operational or started anew: it does not hold what it was told any more.
    forgot: bool = False

    def excuse(self, now: float) -> None:
        """Nobody listened until `now`."""
        self.heard_at = now

    def hear(self, nmt_state: int, now: float) -> NotOperational | Rebooted | None:
        """A heartbeat or boot-up message has come."""
        self.heard_at, self.lost = now, False
        state = nmt_state & 0x7F  # bit 7 is node guarding's toggle
        if state == BOOT_UP:
            self.operational, self.forgot = False, True
            return Rebooted(self.node)
        was_operational, self.operational = self.operational, state == OPERATIONAL
        if self.operational or not was_operational:
            return None
        self.forgot = True
        return NotOperational(self.node, state)

    def check(self, now: float) -> HeartbeatLost | None:
        """Report a heartbeat that has just become overdue, once."""
        if self.lost or now - self.heard_at <= self.timeout_s:
            return None
        self.lost = True
        return HeartbeatLost(self.node)


@dataclass(slots=True)
class ObedienceWatch:
    """Tells a drive that stays in operation, and one that does so after the NMT stop, too."""

    node: int
    ticks: int = 0
    since_s: float = 0.0
    told: bool = False

    def check(
        self, state: DriveState, target: PowerTarget, now: float
    ) -> Disobedient | Unstoppable | None:
        """Judge a sample of the drive, before it is sent `target` (again)."""
        if target is PowerTarget.ON or state is not DriveState.OPERATION_ENABLED:
            self.ticks, self.told = 0, False
            return None
        if self.ticks == 0:
            self.since_s = now
        self.ticks += 1
        if self.ticks <= PATIENCE_TICKS or now - self.since_s < PATIENCE_S[target]:
            return None
        self.ticks, again, self.told = 0, self.told, True
        return Unstoppable(self.node) if again else Disobedient(self.node)
