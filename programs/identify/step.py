"""Step of the identification: its command line and its outcome."""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from programs.command_line.options import PATH, SOCKET

if TYPE_CHECKING:
    from daemon.config.identified import Entry, IdentifiedPayload

Option = Callable[[Callable[..., None]], Callable[..., None]]
"""Decorator of `click` that adds an option or argument."""

CONFIG: Final = click.option(
    "--config", type=PATH, help="Robot's folder; by default that of the running daemon."
)
JOINTS: Final = click.argument("joints", nargs=-1, metavar="[JOINT]...")
SHARED_OPTIONS: Final[tuple[Option, ...]] = (
    CONFIG,
    click.option("--log", "logs", type=PATH, multiple=True,
                 metavar="FILE",
                 help="Use a recording (.mcap, may be repeated) or a log of another program "
                 "(docs/logs.md) instead of moving the arm."),
    click.option("--dry-run", is_flag=True, help="Write no results and no plots."),
    click.option("--yes", is_flag=True,
                 help="Reset a fault, enable drives that are off, and move the arm, without "
                 "asking; for scripts."),
    SOCKET,
)  # fmt: skip
"""Options of a step that moves the arm, or reads logs instead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Step of the identification, a command of `contactd identify`. `daemon.config.identified`
    states what its entry replaces and depends on."""

    run: Callable[..., bool]
    """Function of an `Identification` and the values of the step's options, which turns
    measurements into entries; True if all are good. Its docstring is the command's help."""
    options: tuple[Option, ...]
    quality: Callable[[Any], str]
    """Quality of an entry in words."""
    order: int
    """Position among the steps, which are numbered in the order of their use."""

    @property
    def name(self) -> str:
        """Name of the command, and of the entry."""
        return self.run.__name__

    @property
    def by_joint(self) -> bool:
        """True if the step takes names of joints."""
        return JOINTS in self.options


def step(
    *options: Option,
    order: int,
    shared: tuple[Option, ...] = SHARED_OPTIONS,
    quality: Callable[[Any], str] = lambda entry: "",
) -> Callable[[Callable[..., bool]], Step]:
    """Decorator that turns a `run` function into a Step."""
    own = (*options, *shared)
    return lambda run: Step(run=run, options=own, quality=quality, order=order)


@dataclass(frozen=True, slots=True)
class Line:
    """Printed result of a step for one joint."""

    joint: str
    verdict: str
    good: bool
    figures: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a step: lines to print, and entries for identified.yaml, by joint."""

    lines: list[Line]
    entries: "dict[str, Entry]" = field(default_factory=dict)
    payloads: "dict[str, IdentifiedPayload]" = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    draw: Callable[[Path], list[Path]] | None = None
    """Function that draws plots into a folder and returns their paths."""
    unfinished: bool = False
    """True if the step continues with the same recordings."""


def now() -> str:
    """Present time as ISO 8601 text: UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
