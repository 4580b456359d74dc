"""Which condition leads to which reaction, and which of several wins."""

from itertools import permutations

import pytest

from daemon.faults.table import EVENT_OF, TABLE, Condition, Finding, Response, strongest
from daemon.modes.table import Event

# What one tick gets over; where what is measured can still be trusted; what ends the program.
# Everything else stops all drives until a person has looked.
EXPECTED = {
    Response.CONTINUE: {Condition.SAMPLE_MISSING, Condition.BUS_DISTURBED, Condition.LATE},
    Response.HOLD: {
        Condition.STARVED,
        Condition.ERROR_PASSIVE,
        Condition.TORQUE_SATURATED,
        Condition.JOINT_LIMIT,
        Condition.OVERRUN,
    },
    Response.FAULT_EXIT: {
        Condition.UNSTOPPABLE,
        Condition.ADAPTER_GONE,
        Condition.PROGRAM_ERROR,
    },
}


def expected(condition: Condition) -> Response:
    found = [reaction for reaction, conditions in EXPECTED.items() if condition in conditions]
    return found[0] if found else Response.QUICK_STOP


@pytest.mark.parametrize("condition", Condition)
def test_reaction(condition: Condition) -> None:
    assert TABLE[condition].response is Finding(condition, "here").response
    assert TABLE[condition].response is expected(condition)


def test_every_row_says_when_and_why() -> None:
    assert list(TABLE) == list(Condition)
    assert all(row.when and row.why for row in TABLE.values())


def test_what_each_reaction_does_to_the_mode() -> None:
    assert EVENT_OF == {
        Response.CONTINUE: None,
        Response.HOLD: Event.DOUBT,
        Response.QUICK_STOP: Event.FAULT,
        Response.FAULT_EXIT: Event.FAULT,
    }


def test_the_order_of_strength() -> None:
    assert Response.CONTINUE < Response.HOLD < Response.QUICK_STOP < Response.FAULT_EXIT


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


def test_nothing_found() -> None:
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
