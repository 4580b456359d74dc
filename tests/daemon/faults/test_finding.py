"""Findings in words, and which of several wins."""

from itertools import permutations

import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding, strongest
from daemon.faults.table import TABLE


@pytest.mark.parametrize("condition", Condition)
def test_a_finding_is_what_its_row_says(condition: Condition) -> None:
    assert Finding(condition, "here").response is TABLE[condition].response
    assert Finding(condition, "here").check == TABLE[condition].check


def test_the_strongest_wins_wherever_it_stands() -> None:
    late, hold = Finding(Condition.LATE), Finding(Condition.OVERRUN)
    fault = Finding(Condition.DRIVE_FAULT, "b")
    for findings in permutations((late, hold, fault)):
        assert strongest(findings) is fault
    assert strongest((late, hold)) is strongest((hold, late)) is hold


def test_the_first_of_equals_wins() -> None:
    stale, fault = Finding(Condition.STALE, "a"), Finding(Condition.DRIVE_FAULT, "b")
    assert strongest((stale, fault)) is stale
    assert strongest((fault, stale)) is fault


def test_no_finding_has_no_strongest() -> None:
    assert strongest(()) is None


def test_words() -> None:
    assert str(Finding(Condition.DRIVE_FAULT, "LElbowRoll")) == "drive fault: LElbowRoll"
    assert str(Finding(Condition.LATE)) == "late tick"
    assert str(Finding(Condition.LATE, "", "12 ms")) == "late tick (12 ms)"
    assert str(Finding(Condition.JUMP, "elbow", "by 1 rad")) == "encoder jump: elbow (by 1 rad)"


def test_figures_that_change_make_no_new_finding() -> None:
    before, after = (Finding(Condition.JUMP, "elbow", figures) for figures in ("1", "2"))
    assert before == after
    assert len({before, after}) == 1
    assert before != Finding(Condition.JUMP, "wrist", "1")
