"""Watch on the heartbeat of one drive (CiA 301), and on the NMT state that it reports.

Time is an argument.
"""

from dataclasses import dataclass

from drivers.api import Kind
from drivers.canopen.events import Fact
from drivers.canopen.ids import BOOT_UP, OPERATIONAL


@dataclass(slots=True)
class HeartbeatWatch:
    """Detects the loss of a heartbeat and the end of operational, and reports each once.

    Made when the drive has just been commanded operational, at `heard_at`.
    """

    node: int
    timeout_s: float
    heard_at: float
    lost: bool = False
    # Heartbeats of before NMT start may still be under way after it: no longer being operational
    # is news only of a drive that was heard to be.
    operational: bool = False
    # It has left NMT operational or started anew: its set-up is lost.
    forgot: bool = False

    def excuse(self, now: float) -> None:
        """Count from `now`: the bus was not read until then."""
        self.heard_at = now

    def hear(self, nmt_state: int, now: float) -> Fact | None:
        """A heartbeat or boot-up message has come."""
        self.heard_at, self.lost = now, False
        state = nmt_state & 0x7F  # bit 7 is node guarding's toggle
        if state == BOOT_UP:
            self.operational, self.forgot = False, True
            return Fact(Kind.RESTARTED, (self.node,), "its set-up is lost")
        was_operational, self.operational = self.operational, state == OPERATIONAL
        if self.operational or not was_operational:
            return None
        self.forgot = True
        # 127 is pre-operational, 4 stopped: its PDOs are off.
        text = f"no longer operational (NMT state {state})"
        return Fact(Kind.DROPPED, (self.node,), text)

    def check(self, now: float) -> Fact | None:
        """Report a heartbeat that has just become overdue, once."""
        if self.lost or now - self.heard_at <= self.timeout_s:
            return None
        self.lost = True
        return Fact(Kind.SILENT, (self.node,))
