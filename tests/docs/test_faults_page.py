"""docs/faults.md says of every condition all that the table does."""

import re
from pathlib import Path

import pytest

from daemon.faults import following, plausibility
from daemon.faults.conditions import Condition, Response
from daemon.faults.detector import STARVED_FACTOR
from daemon.faults.table import TABLE
from drivers.stopping import witness

PAGE = Path(__file__).resolve().parents[2] / "docs" / "faults.md"
WORDS = {
    Response.CONTINUE: "continue",
    Response.HOLD: "hold",
    Response.QUICK_STOP: "quick stop",
    Response.FAULT_EXIT: "fault exit",
}


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def test_every_condition_has_a_section_that_says_all(page: str) -> None:
    sections = dict(
        re.findall(r"^### (.+?)\n\n(.+?)(?=\n\n#|\n\n<)", page, re.MULTILINE | re.DOTALL)
    )
    assert list(sections) == list(Condition)
    for name, text in sections.items():
        row = TABLE[Condition(name)]
        assert text.startswith(f"**{WORDS[row.response].capitalize()}** (`{row.check}`)."), name
        advice = re.sub(r"docs/(\w+)\.md", r"[\1](\1.md)", row.advice)
        assert all(words in text for words in (row.when, row.why, advice)), name


def test_the_pages_that_advice_names_are_there(page: str) -> None:
    named = [name for row in TABLE.values() for name in re.findall(r"docs/\w+\.md", row.advice)]
    assert named
    assert all((PAGE.parents[1] / name).is_file() for name in named)


def test_the_overview_links_every_condition_at_its_response(page: str) -> None:
    rows = re.findall(r"^\| ([a-z ]+) \| (\[.+\)) \|$", page, re.MULTILINE)
    found = {name: words for words, links in rows for name in re.findall(r"\[(.+?)\]\(#", links)}
    assert found == {condition: WORDS[row.response] for condition, row in TABLE.items()}


def test_every_response_is_explained(page: str) -> None:
    explained = re.findall(r"^- \*\*(.+?)\*\*:", page, re.MULTILINE)
    assert explained == list(WORDS.values())


@pytest.mark.parametrize(
    ("constant", "value", "words"),
    [
        (following.TICKS, 20, "for 20 ticks a motor's velocity"),
        (following.PRESSING_SHARE, 0.5, "with half of what it may"),
        (witness.STILL_S, 0.2, "have rested for 0.2 s"),
        (plausibility.STUCK_TRAVEL, 0.1, "while the motor turns by 0.1 rad"),
        (plausibility.STUCK_TICKS, 20, "one value for 20 ticks"),
        (plausibility.SATURATED_SHARE, 0.95, "(95 %)"),
        (plausibility.OVERSPEED_TICKS, 3, "for three ticks"),
        (plausibility.GAP_TOLERANCE, 1.1, "beside the gap and 10 % of it"),
        (STARVED_FACTOR, 3, "up to three times as long"),
    ],
)
def test_the_figures_that_are_no_configuration(
    page: str, constant: float, value: float, words: str
) -> None:
    assert constant == value
    assert words in page
