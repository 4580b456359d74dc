"""Logs as a make of drives: the interface of `drivers.makes` without a bus."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn

from common.errors import ConfigurationError
from drivers.can.load import FrameLoad
from drivers.drive import Counts, Measure, ProfileProblem
from drivers.log.settings import LogDrive, LogProfile

_FINE, _MOST = 1e-9, 1 << 50  # practically no quantisation and no limits


def problems(
    profile: LogProfile, drives: Sequence[LogDrive], folder: Path, period_ms: int, master_node: int
) -> list[ProfileProblem]:
    """No problems."""
    return []


def wrong(drive: LogDrive) -> Iterable[ProfileProblem]:
    """No problems."""
    return ()


def counts(drive: LogDrive, measure: Measure) -> Counts:
    """Integer scale of logged numbers."""
    return Counts(("make",), "numbers", _FINE, 0.0, -_MOST, _MOST)


def frames(
    drives: Sequence[LogDrive], period_s: float, master_node: int = 0
) -> tuple[FrameLoad, ...]:
    """No frames."""
    return ()


def recorded(drives: Sequence[LogDrive], period_s: float) -> NoReturn:
    """Raise ConfigurationError: such an arm has no frames."""
    raise ConfigurationError("`make: log`: joints known only from logs have no frames")
