"""Which condition leads to which reaction, and which of several wins."""

from itertools import permutations

import pytest

from daemon.modes import Event
from daemon.supervisor import EVENT_OF, REACTIONS, Condition, Finding, Reaction, strongest

# Two nuisances that one tick gets over; everything else stops all drives.
HARMLESS = {Condition.SAMPLE_MISSING, Condition.LATE}


@pytest.mark.parametrize("condition", Condition)
def test_reaction(condition: Condition) -> None:
    expected = Reaction.CONTINUE if condition in HARMLESS else Reaction.QUICK_STOP
    assert REACTIONS[condition] is Finding(condition, "here").reaction is expected


def test_what_each_reaction_does_to_the_mode() -> None:
    assert EVENT_OF == {
        Reaction.CONTINUE: None,
        Reaction.HOLD: Event.DOUBT,
        Reaction.QUICK_STOP: Event.FAULT,
    }


def test_the_order_of_strength() -> None:
    assert Reaction.CONTINUE < Reaction.HOLD < Reaction.QUICK_STOP


def test_the_strongest_wins_wherever_it_stands() -> None:
    late, missing = Finding(Condition.LATE, ""), Finding(Condition.SAMPLE_MISSING, "a")
    fault = Finding(Condition.DRIVE_FAULT, "b")
    for findings in permutations((late, missing, fault)):
        assert strongest(findings) is fault


def test_the_first_of_equals_wins() -> None:
    stale, fault = Finding(Condition.STALE, "a"), Finding(Condition.DRIVE_FAULT, "b")
    assert strongest((stale, fault)) is stale
    assert strongest((fault, stale)) is fault


def test_nothing_found() -> None:
    assert strongest(()) is None


def test_words() -> None:
    assert str(Finding(Condition.DRIVE_FAULT, "LElbowRoll")) == "drive fault: LElbowRoll"
    assert str(Finding(Condition.LATE, "")) == "late tick"
