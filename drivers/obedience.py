"""Watching whether one drive stops when it is told to; time is an argument.

A drive may send all that it should and yet not hear us: its RPDO was disabled or mapped anew, its
program has come to grief. It goes on at its last velocity while our heartbeat tells it that all is
well. What it does not do about a setpoint it may still do about an NMT stop, which counts as a loss
of the connection (0x6007). If that does not help either, only our silence is left.
"""

from dataclasses import dataclass
from typing import Final

from drivers.cia402 import DriveState, PowerTarget
from drivers.events import Disobedient, Unstoppable

#: How long a drive may stay in operation after it was told otherwise [s]. It needs two ticks to
#: quick-stop and to say so; to switch off it may wait for its brake.
PATIENCE_S: Final = {PowerTarget.QUICK_STOP: 0.05, PowerTarget.OFF: 1.0}
#: And so many samples must have said so, however late they came.
PATIENCE_TICKS: Final = 5


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
        """To be called with every sample of the drive, before it is told `target` (again)."""
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
