"""Makes of drives: what the configuration asks of each before the first tick."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Protocol

from drivers.can.load import FrameLoad
from drivers.canopen import make as canopen
from drivers.canopen.settings import CanopenProfile
from drivers.drive import Counts, Drive, Measure, ProfileProblem

DriveProfile = CanopenProfile


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
        """What is wrong with a profile, of which these are the drives, once each."""

    def counts(self, drive: Drive[Any], measure: Measure) -> Counts:
        """Integers of a quantity of a drive. Raises ConfigurationError if it has none."""

    def frames(
        self, drives: Sequence[Drive[Any]], period_s: float, master_node: int = 127
    ) -> tuple[FrameLoad, ...]:
        """Every periodic frame of an arm."""


MAKES: Final[dict[type, Make]] = {CanopenProfile: canopen}


def make_of(profile: DriveProfile) -> Make:
    """Make of a drive of this kind."""
    return MAKES[type(profile)]
