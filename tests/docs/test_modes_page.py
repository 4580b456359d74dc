"""Tables of docs/modes.md against `daemon.modes.table`, row by row, with nothing else."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

from daemon.modes.table import DISARMING, TRANSITIONS, Event, Mode

PAGE = Path(__file__).resolve().parents[2] / "docs" / "modes.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def leaving(table: Mapping[tuple[Mode, Event], Mode]) -> list[str]:
    """Arrows of the diagram: rows that change the mode, joined where they share both ends."""
    events: dict[tuple[Mode, Mode], list[str]] = {}
    for (mode, event), after in table.items():
        if after is not mode:
            events.setdefault((mode, after), []).append(event)
    return [f"{a} --> {b} : {', '.join(names)}" for (a, b), names in events.items()]


def staying(table: Mapping[tuple[Mode, Event], Mode]) -> list[str]:
    """Rows of the second table: what is accepted and leaves the mode as it is."""
    events: dict[Mode, list[str]] = {}
    for (mode, event), after in table.items():
        if after is mode:
            events.setdefault(mode, []).append(f"`{event}`")
    return [f"| `{mode}` | {', '.join(names)} |" for mode, names in events.items()]


def arrows_on(page: str) -> list[str]:
    """Without the arrow from the start, which is no row of the table."""
    found = re.findall(r"^ *(\w+ --> \w+ : .+)$", page, re.MULTILINE)
    return [line.strip() for line in found]


def section(page: str, title: str) -> str:
    return page.partition(f"## {title}\n")[2].partition("\n## ")[0]


def first_column(text: str) -> list[str]:
    return re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)


def test_the_diagram_is_the_table(page: str) -> None:
    assert sorted(arrows_on(page)) == sorted(leaving(TRANSITIONS))


def test_what_changes_nothing_is_the_table(page: str) -> None:
    rows = re.findall(r"^\| `\w+` \| .+ \|$", section(page, "What changes nothing"), re.MULTILINE)
    assert rows == staying(TRANSITIONS)


@pytest.mark.parametrize(("title", "names"), [("Modes", Mode), ("Events", Event)])
def test_every_name_is_explained_once(page: str, title: str, names: Iterable[str]) -> None:
    assert first_column(section(page, title)) == [str(name) for name in names]


def test_what_disarms(page: str) -> None:
    rows = [line.split("|") for line in section(page, "Events").splitlines()]
    marked = {row[1].strip(" `") for row in rows if len(row) > 3 and row[3].strip() == "x"}
    assert marked == set(DISARMING)
