"""Figures and pages that docs/faults.md names beside the table that it is made from."""

import re
from pathlib import Path

import pytest

from daemon.faults import following, plausibility
from daemon.faults.detector import STARVED_FACTOR
from daemon.faults.table import TABLE
from drivers.stopping import witness

PAGE = Path(__file__).resolve().parents[2] / "docs" / "faults.md"


@pytest.fixture(scope="module")
def page() -> str:
    return PAGE.read_text(encoding="utf-8")


def test_the_pages_that_advice_names_are_there(page: str) -> None:
    named = [name for row in TABLE.values() for name in re.findall(r"docs/\w+\.md", row.advice)]
    assert named
    assert all((PAGE.parents[1] / name).is_file() for name in named)


@pytest.mark.parametrize(
    ("constant", "value", "words"),
    [
        (following.TICKS, 20, "for 20 ticks a motor's velocity"),
        (following.PRESSING_SHARE, 0.5, "with half of its limit"),
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
