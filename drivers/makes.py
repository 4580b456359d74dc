"""Makes of drives: what the configuration asks of each before the first tick."""

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
"""Make of a profile that names none."""


class RecordedTicks(Protocol):
    """Ticks of recorded frames: samples and setpoints again, as they were."""

    velocity: Vector
    """Target velocities that were sent last (n,) [rad/s]."""

    def begins(self, can_id: int, data: bytes, *, sent: bool) -> bool:
        """True for the frame that a tick begins with."""

    def begin(self, now: float) -> None:
        """Begin a tick."""

    def take(self, can_id: int, data: bytes, *, sent: bool) -> None:
        """Take a frame of it, its first as well."""

    def finish(self) -> Samples:
        """End the tick."""


LANGUAGES: Final[dict[type, type[Language]]] = {
    DamiaoProfile: DamiaoLanguage, RobStrideProfile: RobStrideLanguage,
}  # fmt: skip
"""Languages of motors that let go when nothing is sent to them."""


def guardian_of(drives: Sequence[Drive[Any]]) -> Guardian | None:
    """Guardian of an arm; None where its drives stop and hold by themselves."""
    language = LANGUAGES.get(type(drives[0].profile))
    return None if language is None else Guardian(drives, language(drives))


class Make(Protocol):
    """One make: the module `make` in its folder."""

    def problems(
        self,
        profile: Any,
        drives: Sequence[Drive[Any]],
        folder: Path,
        period_ms: int,
        master_node: int,
    ) -> list[ProfileProblem]:
        """Problems of a profile, of which these are the drives, once each."""

    def wrong(self, drive: Drive[Any]) -> Iterable[ProfileProblem]:
        """Problems of a joint with such a drive, at its fields."""

    def counts(self, drive: Drive[Any], measure: Measure) -> Counts:
        """Integers of a quantity of a drive. Raises ConfigurationError if it has none."""

    def frames(
        self, drives: Sequence[Drive[Any]], period_s: float, master_node: int = 127
    ) -> tuple[FrameLoad, ...]:
        """Every periodic frame of an arm."""

    def recorded(self, drives: Sequence[Drive[Any]], period_s: float) -> RecordedTicks:
        """Ticks of recorded frames of an arm."""


MAKES: Final[dict[type, Make]] = {
    CanopenProfile: canopen, DamiaoProfile: damiao, RobStrideProfile: robstride,
    LogProfile: log,
}  # fmt: skip


def make_of(profile: DriveProfile) -> Make:
    """Make of a drive of this kind."""
    return MAKES[type(profile)]
