"""Travel of a joint until it stands, and the time that each stage of its stop takes. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from drivers.drive import Drive, DriveKind

#: A drive needs two ticks to take a quick stop from its RPDO and to report it.
FEWEST_TICKS: Final = 3


@dataclass(frozen=True, slots=True)
class Travel:
    """Travel of a joint from a fault on, of a drive that goes on at its velocity limit and obeys
    nothing; and of one that goes its `own` way, faster, and obeys a quick stop [rad at the link].
    """

    noticing: float  # until the fault is found
    stages: float  # until the last stage begins
    patience: float  # until the drive misses us
    braking: float  # while it decelerates
    own: float  # of the other

    @property
    def total(self) -> float:
        """Travel between the fault and standstill, at worst [rad]."""
        return self.noticing + self.stages + self.patience + self.braking


def least_patience_s(drives: Sequence[Drive[DriveKind]]) -> float:
    """Shortest time that a drive waits for us [s]."""
    return min(drive.profile.patience_s for drive in drives)


def stage_ticks(patience_s: float, period_s: float) -> int:
    """Ticks of the first stage; at full speed three times as many are left before silence. They
    take the drives' patience, if that leaves a drive the time to answer."""
    return max(FEWEST_TICKS, int(patience_s / period_s / 3.0 + 1e-9))


def worst_travel(
    drives: Sequence[Drive[DriveKind]],
    period_s: float,
    noticing_s: float,
    speed_margin: float = 1.0,
) -> list[Travel]:
    """Worst travel of each joint: full speed v until the fault is found, for the stages before
    silence, and for the drive's patience; then its quick stop, v^2 / (2 a). Its own way is one of
    `speed_margin` times v, beyond which it is found at once."""
    stages_s = 3 * stage_ticks(least_patience_s(drives), period_s) * period_s
    return [
        Travel(
            noticing=drive.velocity * noticing_s,
            stages=drive.velocity * stages_s,
            patience=drive.velocity * drive.profile.patience_s,
            braking=drive.velocity**2 / (2.0 * drive.quick_stop),
            own=_braked(drive, speed_margin, noticing_s + FEWEST_TICKS * period_s),
        )
        for drive in drives
    ]


def _braked(drive: Drive[DriveKind], speed_margin: float, seconds: float) -> float:
    """Travel at so many times its velocity limit for so long, and then down its quick stop."""
    speed = speed_margin * drive.velocity
    return speed * seconds + speed**2 / (2.0 * drive.quick_stop)
