"""Response to each condition, and which of them fails which arming check."""

from collections.abc import Mapping
from typing import Any

import pytest

from daemon.faults.conditions import Condition, Response
from daemon.faults.table import TABLE
from daemon.modes.table import Event
from drivers.api import Kind

# A condition of one tick; one beside which measurements are still trusted; an end of the program.
# All others stop all drives until a reset.
C = Condition
RESPONSES = {
    Response.CONTINUE: {C.SAMPLE_MISSING, C.BUS_LOADED, C.BUS_DISTURBED, C.LATE},
    Response.HOLD: {
        *(C.STARVED, C.OLD, C.NOT_SENSING, C.ERROR_PASSIVE, C.TORQUE_SATURATED, C.JOINT_LIMIT),
        *(C.OVERRUN, C.UNGUARDED),
    },
    Response.FAULT_EXIT: {C.ADAPTER_GONE, C.PROGRAM_ERROR},
}
# All others fail the check that is called as the table is.
CHECKS = {
    "drives": {
        *(C.DRIVE_FAULT, C.DRIVE_DROPPED, C.SUPPLY_LOST, C.NOT_FOLLOWING, C.IGNORES_SETPOINT),
        *(C.NOT_SEEN_TO_STOP, C.UNPROVED),
    },
    "samples": {C.SAMPLE_MISSING, C.STALE, C.STARVED, C.OLD},
    "estimator": {C.NOT_SENSING},
    "heartbeats": {C.HEARTBEAT_LOST, C.UNHEARD, C.UNGUARDED},
    "emergencies": {C.EMERGENCY},
    "set-up": {C.REBOOTED},
    "residual": {C.RESIDUAL_LIMIT},
    "limits": {C.JOINT_LIMIT},
    "loop": {C.LATE, C.OVERRUN, C.ABSENT},
}


def group_of(condition: Condition, groups: Mapping[Any, set[Condition]], otherwise: Any) -> Any:
    """Key of the group that has the condition."""
    return next((key for key, group in groups.items() if condition in group), otherwise)


@pytest.mark.parametrize("condition", Condition)
def test_response(condition: Condition) -> None:
    assert TABLE[condition].response is group_of(condition, RESPONSES, Response.QUICK_STOP)


@pytest.mark.parametrize("condition", Condition)
def test_arming_check(condition: Condition) -> None:
    assert TABLE[condition].check == group_of(condition, CHECKS, "faults")


def test_every_row_is_complete() -> None:
    assert list(TABLE) == list(Condition)
    assert all(row.when and row.why and row.advice for row in TABLE.values())


def test_the_advice_names_reset_for_latched_faults_and_arm_for_others() -> None:
    """No advice names a command that would be refused."""
    for condition, row in TABLE.items():
        reset = "`contactctl reset`" in row.advice
        assert reset is (row.response is Response.QUICK_STOP), condition
        arm = "`contactctl arm`" in row.advice
        assert arm is (row.response is Response.HOLD), condition


def test_a_source_belongs_to_one_condition() -> None:
    sources = [row.source for row in TABLE.values() if row.source is not None]
    assert len(set(sources)) == len(sources)
    assert set(sources) == set(Kind) - {Kind.DISTURBED}, "which is judged by how long it lasts"


def test_the_event_of_each_response() -> None:
    assert {response: response.event for response in Response} == {
        Response.CONTINUE: None,
        Response.HOLD: Event.DOUBT,
        Response.QUICK_STOP: Event.FAULT,
        Response.FAULT_EXIT: Event.FAULT,
    }


def test_the_order_of_strength() -> None:
    assert Response.CONTINUE < Response.HOLD < Response.QUICK_STOP < Response.FAULT_EXIT
