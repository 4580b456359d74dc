"""Sources of measurements: what each step asks of a live arm, and logs that answer it as well."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from arrays import Vector
from daemon.config.schema import Configuration
from daemon.identify.measured import Measured, read_measured
from errors import ConfigurationError


class Source(Protocol):
    """Source of measurements: a live arm, or logs."""

    def wiring(self, joint: str, to_go_on: str) -> Measured:
        """Measurements of one joint's motor, moved both ways through its gap; `to_go_on` is said
        where that is stopped."""

    def pushed(self, joint: str, ask: Callable[[], bool]) -> tuple[Vector, bool]:
        """Positions (N,) [rad] of a link that a person pushes, and whether it went upward, as `ask`
        returns. Raises ConfigurationError where nobody can be asked."""

    def gap(self, joint: str, *, by_hand: bool) -> Measured:
        """Measurements of one joint whose motor turns to and fro, or whose link is moved by hand
        while its motor stands. Raises UnobservableError where the first shows nothing."""

    def friction(self, seconds: float) -> Measured:
        """Measurements of all joints, moved without contact."""

    def masses(self, seconds: float) -> Measured:
        """Measurements of all joints, moved without contact and with an empty hand."""

    def payload(self, name: str, seconds: float) -> Measured:
        """Measurements of all joints, moved without contact and with a load in the hand."""

    def encoders(self, seconds: float) -> Measured:
        """Measurements of all joints, moved without contact, that tell the errors of encoders."""

    def thresholds(self, seconds: float) -> Measured:
        """Measurements of all joints, moved without contact, with residuals."""

    def conclude(self, step: str, stamp: str) -> None:
        """Close a step, whose results are printed and written."""

    def serials(self) -> dict[str, int | None]:
        """Serial numbers of the drives, by joint; empty where they are not known."""

    def recover(self, *, on: bool) -> bool:
        """After a fault have the arm hold, or be off; False where that is for the person to do."""

    def close(self, *, well: bool, written: bool) -> None:
        """End it; `well`: no error and nobody stopped it; `written`: there are results."""


class Recorded:
    """Logs as a source: all of them serve each step."""

    def __init__(self, paths: tuple[Path, ...], configuration: Configuration) -> None:
        self._paths, self._configuration = paths, configuration

    def wiring(self, joint: str, to_go_on: str) -> Measured:
        return self._read()

    def pushed(self, joint: str, ask: Callable[[], bool]) -> tuple[Vector, bool]:
        raise ConfigurationError("a log does not say where the links stood: `identify zero` asks")

    def gap(self, joint: str, *, by_hand: bool) -> Measured:
        return read_measured(self._paths, self._configuration, gap_of=joint)

    def friction(self, seconds: float) -> Measured:
        return self._read()

    masses = thresholds = encoders = friction

    def payload(self, name: str, seconds: float) -> Measured:
        return self._read()

    def conclude(self, step: str, stamp: str) -> None:
        """Do nothing: a log remains as it is."""

    def serials(self) -> dict[str, int | None]:
        return {}

    def recover(self, *, on: bool) -> bool:
        return False

    def close(self, *, well: bool, written: bool) -> None:
        """Do nothing: no connection is open."""

    def _read(self) -> Measured:
        return read_measured(self._paths, self._configuration)
