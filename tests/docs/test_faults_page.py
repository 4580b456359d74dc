"""docs/faults.md shows the table of `daemon.faults.table`, and the bounds that are in force."""

import re
from pathlib import Path

import msgspec
import pytest

from daemon.config.schema import SupervisorSettings
from daemon.faults import following, plausibility
from daemon.faults.detector import STARVED_FACTOR
from daemon.faults.table import TABLE, Condition, Response
from drivers import watches
from drivers.cia402 import PowerTarget

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


def rows() -> list[str]:
    """The table as it should be on the page."""
    return [
        f"| {condition} | {row.when} | **{WORDS[row.response]}** | {row.why} |"
        for condition, row in TABLE.items()
    ]


def test_the_table_is_the_one_the_program_runs_on(page: str) -> None:
    shown = re.findall(r"^\| .+ \| .+ \| \*\*.+\*\* \| .+ \|$", page, re.MULTILINE)
    assert shown == rows()
    assert len(shown) == len(Condition)


def test_every_reaction_is_explained(page: str) -> None:
    explained = re.findall(r"^- \*\*(.+?)\*\*:", page, re.MULTILINE)
    assert explained == list(WORDS.values())


def test_every_bound_and_its_default(page: str) -> None:
    shown = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", page, re.MULTILINE)
    defaults = msgspec.structs.asdict(SupervisorSettings())
    assert {name: float(value) for name, value in shown} == defaults


@pytest.mark.parametrize(
    ("constant", "value", "words"),
    [
        (following.TICKS, 20, "for 20 ticks a motor's velocity"),
        (following.PRESSING_SHARE, 0.5, "with half of what it may"),
        (watches.PATIENCE_TICKS, 5, "5 ticks and 50 ms after a quick stop"),
        (watches.PATIENCE_S[PowerTarget.QUICK_STOP], 0.05, "50 ms after a quick stop"),
        (watches.PATIENCE_S[PowerTarget.OFF], 1.0, "1 s after it was switched off"),
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
