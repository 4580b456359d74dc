"""Response to each condition, and which of them fails which arming check."""

import pytest

from daemon.faults.conditions import Condition, Response
from daemon.faults.table import TABLE
from daemon.modes.table import Event
from drivers.api import Kind

# What one tick gets over; where what is measured can still be trusted; what ends the program.
# Everything else stops all drives until a person has looked.
EXPECTED = {
    Response.CONTINUE: {
        Condition.SAMPLE_MISSING,
        Condition.BUS_LOADED,
        Condition.BUS_DISTURBED,
        Condition.LATE,
    },
    Response.HOLD: {
        Condition.STARVED,
        Condition.OLD,
        Condition.NOT_SENSING,
        Condition.ERROR_PASSIVE,
        Condition.TORQUE_SATURATED,
        Condition.JOINT_LIMIT,
        Condition.OVERRUN,
        Condition.UNGUARDED,
    },
    Response.FAULT_EXIT: {Condition.ADAPTER_GONE, Condition.PROGRAM_ERROR},
}


def expected(condition: Condition) -> Response:
    found = [response for response, conditions in EXPECTED.items() if condition in conditions]
    return found[0] if found else Response.QUICK_STOP


@pytest.mark.parametrize("condition", Condition)
def test_response(condition: Condition) -> None:
    assert TABLE[condition].response is expected(condition)


# All others fail the check that is called as the table is.
CHECKS = {
    "drives": {
        Condition.DRIVE_FAULT,
        Condition.DRIVE_DROPPED,
        Condition.SUPPLY_LOST,
        Condition.NOT_FOLLOWING,
        Condition.IGNORES_SETPOINT,
        Condition.NOT_SEEN_TO_STOP,
        Condition.UNPROVED,
    },
    "samples": {Condition.SAMPLE_MISSING, Condition.STALE, Condition.STARVED, Condition.OLD},
    "estimator": {Condition.NOT_SENSING},
    "heartbeats": {Condition.HEARTBEAT_LOST, Condition.UNHEARD, Condition.UNGUARDED},
    "emergencies": {Condition.EMERGENCY},
    "set-up": {Condition.REBOOTED},
    "residual": {Condition.RESIDUAL_LIMIT},
    "limits": {Condition.JOINT_LIMIT},
    "loop": {Condition.LATE, Condition.OVERRUN, Condition.ABSENT},
}


@pytest.mark.parametrize("condition", Condition)
def test_arming_check(condition: Condition) -> None:
    named = [check for check, conditions in CHECKS.items() if condition in conditions]
    assert TABLE[condition].check == (named[0] if named else "faults")


def test_every_row_says_all() -> None:
    assert list(TABLE) == list(Condition)
    assert all(row.when and row.why and row.advice for row in TABLE.values())


def test_what_is_latched_takes_a_reset_and_what_is_not_does_not() -> None:
    """No advice sends a person to a command that would be refused."""
    for condition, row in TABLE.items():
        reset = "`contactctl reset`" in row.advice
        assert reset is (row.response is Response.QUICK_STOP), condition
        arm = "`contactctl arm`" in row.advice
        assert arm is (row.response is Response.HOLD), condition


def test_a_source_belongs_to_one_condition() -> None:
    sources = [row.source for row in TABLE.values() if row.source is not None]
    assert len(set(sources)) == len(sources)
    assert set(sources) == set(Kind) - {Kind.DISTURBED}, "which is judged by how long it lasts"


def test_what_each_response_does_to_the_mode() -> None:
    assert {response: response.event for response in Response} == {
        Response.CONTINUE: None,
        Response.HOLD: Event.DOUBT,
        Response.QUICK_STOP: Event.FAULT,
        Response.FAULT_EXIT: Event.FAULT,
    }


def test_the_order_of_strength() -> None:
    assert Response.CONTINUE < Response.HOLD < Response.QUICK_STOP < Response.FAULT_EXIT
