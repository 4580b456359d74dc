"""Worst-case travel of a joint to standstill, and the duration of each stage of its stop. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from drivers.drive import Drive, DriveKind

#: A drive needs two ticks to accept a quick stop from its RPDO and to report it.
FEWEST_TICKS: Final = 3


@dataclass(frozen=True, slots=True)
class Travel:
    """Travel of a joint after a fault [rad at the link]: of a drive that continues at its velocity
    limit and obeys no command, in parts; and of a runaway, faster, that obeys a quick stop (`own`).
    """

    detection: float  # until the fault is detected
    stages: float  # until the last stage begins
    master_timeout: float  # until the drive misses the master
    braking: float  # while it decelerates
    own: float  # total of the runaway

    @property
    def total(self) -> float:
        """Worst-case travel between fault and standstill [rad]."""
        return self.detection + self.stages + self.master_timeout + self.braking


def least_master_timeout_s(drives: Sequence[Drive[DriveKind]]) -> float:
    """Shortest master timeout of the drives [s]."""
    return min(drive.profile.master_timeout_s for drive in drives)


def stage_ticks(master_timeout_s: float, period_s: float) -> int:
    """Ticks of the first stage; at full speed, silence begins after three times as many. Together
    they last the drives' master timeout, unless that leaves a drive no time to answer."""
    return max(FEWEST_TICKS, int(master_timeout_s / period_s / 3.0 + 1e-9))


def worst_travel(
    drives: Sequence[Drive[DriveKind]],
    period_s: float,
    detection_s: float,
    speed_margin: float = 1.0,
) -> list[Travel]:
    """Worst-case travel of each joint: full speed v until the fault is detected, for the stages
    before silence, and for the drive's master timeout; then its quick stop, v^2 / (2 a). A runaway
    has `speed_margin` times v, above which it is detected at once."""
    stages_s = 3 * stage_ticks(least_master_timeout_s(drives), period_s) * period_s
    return [
        Travel(
            detection=drive.velocity * detection_s,
            stages=drive.velocity * stages_s,
            master_timeout=drive.velocity * drive.profile.master_timeout_s,
            braking=drive.velocity**2 / (2.0 * drive.quick_stop),
            own=_braked(drive, speed_margin, detection_s + FEWEST_TICKS * period_s),
        )
        for drive in drives
    ]


def _braked(drive: Drive[DriveKind], speed_margin: float, seconds: float) -> float:
    """Travel at `speed_margin` times its velocity limit for `seconds`, then down its quick stop."""
    speed = speed_margin * drive.velocity
    return speed * seconds + speed**2 / (2.0 * drive.quick_stop)
