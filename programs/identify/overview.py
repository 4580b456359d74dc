"""Overview of the identification: known parameters of each joint, quality, age, and next step.

Pure functions of a configuration and its identified.yaml; time is an argument.
"""

from dataclasses import dataclass, field
from datetime import datetime
from typing import Final, get_args

from daemon.config.evidence import outdated, unidentified, void_payloads
from daemon.config.identified import ENTRIES, used_entries
from daemon.config.load import Robot
from daemon.config.schema import ArmingStep
from daemon.protocol.text import printable
from programs.identify.steps import STEPS

COLUMNS: Final[tuple[ArmingStep, ...]] = get_args(ArmingStep)


@dataclass(frozen=True, slots=True)
class Cell:
    """State of one step of one joint in words, and whether it is usable."""

    text: str
    good: bool


@dataclass(frozen=True, slots=True)
class Overview:
    """Cells by joint and step, and the command to run next, empty if nothing is missing."""

    cells: dict[str, dict[ArmingStep, Cell]]
    following: str
    payloads: dict[str, Cell] = field(default_factory=dict)
    """Identified payloads, by name."""


def overview(robot: Robot, now: datetime) -> Overview:
    """Overview of one robot at time `now`."""
    c, found = robot.configuration, robot.identified
    missing = {step: unidentified(step, found, c) for step in COLUMNS}
    void = {step: outdated(step, found, c, robot.urdf) for step in COLUMNS}
    cells: dict[str, dict[ArmingStep, Cell]] = {}
    for joint in c.joints:
        entries = found.joints.get(joint.name) if found is not None else None
        row: dict[ArmingStep, Cell] = {}
        for step in COLUMNS:
            entry = getattr(entries, step, None)
            if joint.name in missing[step]:
                optional = ENTRIES[step].optional
                row[step] = Cell("as the URDF" if optional else "missing", good=optional)
            elif entry is None or step not in used_entries(joint, found):
                unused = f" ({STEPS[step].quality(entry)} is not used)" if entry else ""
                row[step] = Cell(f"known: {printable(joint.known[step])}{unused}", good=True)
            else:
                text = f"{STEPS[step].quality(entry)}, {_age(entry.date, now)}"
                if step == "gap" and entries is not None and entries.encoders is not None:
                    text += ", link encoder corrected"
                again = joint.name in void[step]
                row[step] = Cell(f"void, was {text}" if again else text, good=not again)
        cells[joint.name] = row
    payloads = _payloads(robot, now)
    for step in COLUMNS:
        names = [name for name, row in cells.items() if not row[step].good]
        if names:
            behind = f" {' '.join(names)}" if STEPS[step].by_joint else ""
            return Overview(cells, f"contactd identify {step}{behind}", payloads)
    return Overview(cells, "", payloads)


def _payloads(robot: Robot, now: datetime) -> dict[str, Cell]:
    """Cells of identified payloads, which a change of friction or masses invalidates."""
    void, cells = void_payloads(robot.identified, robot.configuration, robot.urdf), {}
    for name, load in (robot.identified.payloads if robot.identified else {}).items():
        text = f"{STEPS['payload'].quality(load)}, {_age(load.date, now)}"
        valid = name not in void
        cells[printable(name)] = Cell(text if valid else f"void, was {text}", good=valid)
    return cells


def _age(date: str, now: datetime) -> str:
    try:
        days = (now - datetime.fromisoformat(date)).days
    except (ValueError, TypeError):  # a date typed by hand, perhaps without time zone
        return printable(date)[:30]
    return "today" if days < 1 else f"{days} d ago"
