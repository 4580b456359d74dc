"""Rows of docs/modes.md, read back: every one of `daemon.modes.table`, and nothing else."""

import re
from pathlib import Path

import pytest

from daemon.modes.table import DISARMING, TRANSITIONS, Event, Mode

PAGE = Path(__file__).resolve().parents[2] / "docs" / "modes.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def section(page: str, title: str) -> str:
    return page.partition(f"## {title}\n")[2].partition("\n## ")[0]


def test_diagram_and_what_changes_nothing_are_all_transitions(page: str) -> None:
    shown = [
        (Mode(before), Event(event), Mode(after))
        for before, after, events in re.findall(r"^ +(\w+) --> (\w+) : (.+)$", page, re.MULTILINE)
        for event in events.split(", ")
    ]
    table = section(page, "What changes nothing")
    for mode, events in re.findall(r"^\| `(\w+)` \| (.+) \|$", table, re.MULTILINE):
        shown += [(Mode(mode), Event(event.strip("`")), Mode(mode)) for event in events.split(", ")]
    assert sorted(shown) == sorted((*row, after) for row, after in TRANSITIONS.items())


@pytest.mark.parametrize(("title", "names"), [("Modes", Mode), ("Events", Event)])
def test_every_name_is_explained_once(page: str, title: str, names: type[Mode | Event]) -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", section(page, title), re.MULTILINE)
    assert [name for name, _ in rows] == list(names)


def test_what_disarms(page: str) -> None:
    rows = [line.split("|") for line in section(page, "Events").splitlines()]
    marked = {row[1].strip(" `") for row in rows if len(row) > 3 and row[3].strip() == "x"}
    assert marked == set(DISARMING)
