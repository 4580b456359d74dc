"""Makes of drives: functions of each make that the configuration needs before the first tick."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

from common.arrays import Vector
from drivers.api import Samples
from drivers.can.load import FrameLoad
from drivers.canopen import make as canopen
from drivers.canopen.settings import CanopenProfile
from drivers.damiao import make as damiao
from drivers.damiao.language import DamiaoLanguage
from drivers.damiao.settings import DamiaoProfile
from drivers.drive import Counts, Drive, Measure, ProfileProblem
from drivers.log import make as log
from drivers.log.settings import LogProfile
from drivers.motors.guardian import Guardian
from drivers.motors.language import Language
from drivers.robstride import make as robstride
from drivers.robstride.language import RobStrideLanguage
from drivers.robstride.settings import RobStrideProfile

DriveProfile = CanopenProfile | DamiaoProfile | RobStrideProfile | LogProfile
USUAL: Final = "canopen"
"""Default make, of a profile that names none."""


class RecordedTicks(Protocol):
    """Reconstruction of ticks, with samples and setpoints, from recorded frames."""

    velocity: Vector
    """Most recently sent target velocities (n,) [rad/s]."""

    def begins(self, can_id: int, data: bytes, *, sent: bool) -> bool:
        """True if this frame begins a tick."""

    def begin(self, now: float) -> None:
        """Begin a tick."""

    def take(self, can_id: int, data: bytes, *, sent: bool) -> None:
        """Take a frame of the tick, including its first."""

    def finish(self) -> Samples:
        """End the tick and return its samples."""


LANGUAGES: Final[dict[type, type[Language]]] = {
    DamiaoProfile: DamiaoLanguage, RobStrideProfile: RobStrideLanguage,
}  # fmt: skip
"""Languages of motors that release (drop their torque) when they receive no frames."""


def guardian_of(drives: Sequence[Drive[Any]]) -> Guardian | None:
    """Guardian of an arm; None if its drives stop and hold by themselves."""
    language = LANGUAGES.get(type(drives[0].profile))
    return None if language is None else Guardian(drives, language(drives))


class Make(Protocol):
    """Interface of one make: the module `make` in its folder."""

    def problems(
        self,
        profile: Any,
        drives: Sequence[Drive[Any]],
        folder: Path,
        period_ms: int,
        master_node: int,
    ) -> list[ProfileProblem]:
        """Problems of a profile that these drives use, each reported once."""

    def wrong(self, drive: Drive[Any]) -> Iterable[ProfileProblem]:
        """Problems of the joint with this drive, by field."""

    def counts(self, drive: Drive[Any], measure: Measure) -> Counts:
        """Integer scale of a quantity of a drive. Raises ConfigurationError if it has none."""

    def frames(
        self, drives: Sequence[Drive[Any]], period_s: float, master_node: int = 127
    ) -> tuple[FrameLoad, ...]:
        """All periodic frames of an arm."""

    def recorded(self, drives: Sequence[Drive[Any]], period_s: float) -> RecordedTicks:
        """Reconstruction of an arm's ticks from its recorded frames."""


MAKES: Final[dict[type, Make]] = {
    CanopenProfile: canopen, DamiaoProfile: damiao, RobStrideProfile: robstride,
    LogProfile: log,
}  # fmt: skip


def make_of(profile: DriveProfile) -> Make:
    """Make to which a profile belongs."""
    return MAKES[type(profile)]
