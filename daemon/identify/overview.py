"""Overview of the identification: what is known of each joint, how well, how old, what is next.

Pure: from a configuration and its identified.yaml; time is an argument.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from daemon.config.evidence import OPTIONAL, outdated, unidentified
from daemon.config.identified import (
    FrictionEntry,
    GapEntry,
    MassesEntry,
    ThresholdsEntry,
    WiringEntry,
)
from daemon.config.load import Robot
from daemon.config.marks import marks
from daemon.config.schema import Step
from daemon.protocol.messages import printable

STEPS: tuple[Step, ...] = ("wiring", "gap", "masses", "friction", "thresholds")
"""In the order in which they stand on each other."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One step of one joint: its state in words, and whether it may be used."""

    text: str
    good: bool


@dataclass(frozen=True, slots=True)
class Overview:
    """Cells by joint and step, and the command to run next; empty where nothing is missing."""

    cells: dict[str, dict[Step, Cell]]
    following: str
    payloads: dict[str, Cell] = field(default_factory=dict)
    """Loads that were weighed, by name"""


def overview(robot: Robot, now: datetime) -> Overview:
    """Overview of one robot at a time."""
    c, found = robot.configuration, robot.identified
    missing = {step: unidentified(step, found, c) for step in STEPS}
    void = {step: outdated(step, found, c, robot.urdf) for step in STEPS}
    cells: dict[str, dict[Step, Cell]] = {}
    for joint in c.joints:
        entries = found.joints.get(joint.name) if found is not None else None
        row: dict[Step, Cell] = {}
        for step in STEPS:
            entry = getattr(entries, step, None)
            if joint.name in missing[step]:
                optional = step in OPTIONAL
                row[step] = Cell("as the URDF" if optional else "missing", good=optional)
            elif entry is None:
                row[step] = Cell(f"known: {printable(joint.known[step])}", good=True)
            else:
                text = f"{_QUALITY[step](entry)}, {_age(entry.date, now)}"
                if step == "gap" and entries is not None and entries.encoders is not None:
                    text += ", link encoder corrected"
                again = joint.name in void[step]
                row[step] = Cell(f"void, was {text}" if again else text, good=not again)
        cells[joint.name] = row
    payloads = _payloads(robot, now)
    for step in STEPS:
        names = [name for name, row in cells.items() if not row[step].good]
        if names:
            behind = f" {' '.join(names)}" if step in ("wiring", "gap") else ""
            return Overview(cells, f"contactd identify {step}{behind}", payloads)
    return Overview(cells, "", payloads)


def _of_wiring(entry: WiringEntry) -> str:
    return f"link/motor {entry.follows:.3f}"


def _of_gap(entry: GapEntry) -> str:
    return f"{1e3 * entry.half_gap:.2f} +- {1e3 * entry.confidence:.2f} mrad"


def _of_masses(entry: MassesEntry) -> str:
    return f"{entry.body.mass:.3g} kg, |r| {entry.by_urdf:.2g} -> {entry.by_this:.2g} Nm"


def _payloads(robot: Robot, now: datetime) -> dict[str, Cell]:
    """What was weighed; it depends on what friction does, masses among it."""
    of = marks(robot.configuration, robot.urdf)["friction"]
    cells = {}
    for name, load in (robot.identified.payloads if robot.identified else {}).items():
        text = f"{load.mass:.3g} +- {load.mass_error:.2g} kg, {_age(load.date, now)}"
        valid = load.of == of
        cells[printable(name)] = Cell(text if valid else f"void, was {text}", good=valid)
    return cells


def _of_friction(entry: FrictionEntry) -> str:
    return f"R2 {entry.r2:.3f}"


def _of_thresholds(entry: ThresholdsEntry) -> str:
    seen = f" up to {entry.seen.speed:.2g} rad/s" if entry.seen else ""
    left_out = f", {len(entry.discarded)} stretches left out" if entry.discarded else ""
    return f"{entry.thresholds.contact:.3g} Nm{seen}{left_out}"


_QUALITY: dict[Step, Callable[[Any], str]] = {
    "wiring": _of_wiring,
    "gap": _of_gap,
    "masses": _of_masses,
    "friction": _of_friction,
    "thresholds": _of_thresholds,
}


def _age(date: str, now: datetime) -> str:
    try:
        days = (now - datetime.fromisoformat(date)).days
    except (ValueError, TypeError):  # a date by hand, perhaps without its time zone
        return printable(date)[:30]
    return "today" if days < 1 else f"{days} d ago"
