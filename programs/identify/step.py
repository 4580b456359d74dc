"""Step of the identification: a command, and what comes of it."""

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
"""Decorator of `click` that adds an option or argument"""

CONFIG: Final = click.option(
    "--config", type=PATH, help="Robot's folder; by default that of the running daemon."
)
JOINTS: Final = click.argument("joints", nargs=-1, metavar="[JOINT]...")
SHARED_OPTIONS: Final[tuple[Option, ...]] = (
    CONFIG,
    click.option("--log", "logs", type=PATH, multiple=True,
                 metavar="FILE",
                 help="Learn from a recording (.mcap, may be repeated) or a log of another "
                 "program (docs/logs.md), instead of moving the arm."),
    click.option("--dry-run", is_flag=True, help="Write no results and no pictures."),
    click.option("--yes", is_flag=True,
                 help="Reset a fault, enable drives that are off, and move the arm, without a "
                 "question, for scripts."),
    SOCKET,
)  # fmt: skip
"""Options of a step that moves the arm, or takes logs instead."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Step of the identification, as `contactd identify` offers it. What its entry replaces and
    depends on is stated in `daemon.config.identified`."""

    run: Callable[..., bool]
    """Takes an `Identification` and the values of its own options; from measurements to entries;
    True if all are good. Its docstring is the command's help."""
    options: tuple[Option, ...]
    quality: Callable[[Any], str]
    """Quality of an entry, in words"""
    order: int
    """Place among the steps, in the order in which a person needs them"""

    @property
    def name(self) -> str:
        """Name of the command, and of the entry."""
        return self.run.__name__

    @property
    def by_joint(self) -> bool:
        """True where joints may be named."""
        return JOINTS in self.options


def step(
    *options: Option,
    order: int,
    shared: tuple[Option, ...] = SHARED_OPTIONS,
    quality: Callable[[Any], str] = lambda entry: "",
) -> Callable[[Callable[..., bool]], Step]:
    """Decorator that makes a step of what it runs."""
    own = (*options, *shared)
    return lambda run: Step(run=run, options=own, quality=quality, order=order)


@dataclass(frozen=True, slots=True)
class Line:
    """Result of a step for one joint, for a person."""

    joint: str
    verdict: str
    good: bool
    figures: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a step: lines for a person, and entries for the file, by joint."""

    lines: list[Line]
    entries: "dict[str, Entry]" = field(default_factory=dict)
    payloads: "dict[str, IdentifiedPayload]" = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    draw: Callable[[Path], list[Path]] | None = None
    """Draws pictures in a folder, and returns their paths"""
    unfinished: bool = False
    """The step goes on with the same recordings"""


def now() -> str:
    """Time now as text: UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
