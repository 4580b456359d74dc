"""The power state machine, exhaustively, against the standard's text and an independent drive."""

import itertools

import pytest

from drivers.api import PowerTarget
from drivers.canopen.cia402 import (
    CONDITION_OF,
    CONTROLWORD_TABLE,
    FAULT_RESET,
    STATUSWORD_TABLE,
    DriveState,
    controlword,
    drive_state,
    drive_status,
)
from simulator.state_machine import State, on_controlword

# CiA 402-2, statusword: x is a bit without a say, most significant (bit 6) first, without bit 4.
PATTERNS = {
    DriveState.NOT_READY_TO_SWITCH_ON: "0x 0000",
    DriveState.SWITCH_ON_DISABLED: "1x 0000",
    DriveState.READY_TO_SWITCH_ON: "01 0001",
    DriveState.SWITCHED_ON: "01 0011",
    DriveState.OPERATION_ENABLED: "01 0111",
    DriveState.QUICK_STOP_ACTIVE: "00 0111",
    DriveState.FAULT_REACTION_ACTIVE: "0x 1111",
    DriveState.FAULT: "0x 1000",
}


def fits(statusword: int, pattern: str) -> bool:
    digits = pattern.replace(" ", "")
    bits = "".join("01"[statusword >> bit & 1] for bit in (6, 5, 3, 2, 1, 0))
    return all(wanted in ("x", bit) for wanted, bit in zip(digits, bits, strict=True))


def test_every_statusword_gives_the_state_of_the_standard():
    for low in range(0x80):
        found = [state for state, pattern in PATTERNS.items() if fits(low, pattern)]
        for high in range(0, 0x10000, 0x80):
            assert [drive_state(high | low)] == (found or [DriveState.UNKNOWN])


def test_the_rows_of_the_statusword_table_exclude_each_other():
    for statusword in range(0x80):
        rows = [state for mask, value, state in STATUSWORD_TABLE if statusword & mask == value]
        assert len(rows) <= 1


def test_no_statusword_yet_is_unknown():
    assert drive_state(-1) is DriveState.UNKNOWN


OFF, ON, STOP = PowerTarget.OFF, PowerTarget.ON, PowerTarget.QUICK_STOP
ROWS = [
    ("UNKNOWN", 0x00, 0x02, 0x02), ("NOT_READY_TO_SWITCH_ON", 0x00, 0x02, 0x02),
    ("SWITCH_ON_DISABLED", 0x00, 0x06, 0x02), ("READY_TO_SWITCH_ON", 0x00, 0x07, 0x02),
    ("SWITCHED_ON", 0x00, 0x0F, 0x02), ("OPERATION_ENABLED", 0x00, 0x0F, 0x02),
    ("QUICK_STOP_ACTIVE", 0x00, 0x0F, 0x02), ("FAULT_REACTION_ACTIVE", 0x00, 0x02, 0x02),
    ("FAULT", 0x00, 0x02, 0x02),
]  # fmt: skip


@pytest.mark.parametrize(("state", "off", "on", "stop"), ROWS)
def test_row(state, off, on, stop):
    for target, wanted in ((OFF, off), (ON, on), (STOP, stop)):
        for previous in (0x00, 0x02, 0x80):
            assert controlword(DriveState[state], target, previous) == wanted


@pytest.mark.parametrize("claimed", list(DriveState))
@pytest.mark.parametrize("target", [ON, STOP])
def test_no_single_statusword_takes_the_power_of_a_drive_in_operation(claimed, target):
    """Whatever one frame says, the drive keeps its torque, and gets back to its target."""
    runs = State.OPERATION_ENABLED
    commanded = controlword(DriveState.OPERATION_ENABLED, ON)
    word = controlword(claimed, target, commanded)
    after = on_controlword(runs, commanded, word, 6)
    assert after in (runs, State.QUICK_STOP_ACTIVE)
    assert drive_status(drive(after, target, ticks=3)[-1].value).condition.reached(target)


def test_the_table_has_every_state_and_target():
    assert set(CONTROLWORD_TABLE) == set(DriveState)
    assert {len(row) for row in CONTROLWORD_TABLE.values()} == {len(PowerTarget)}
    assert {row[0] for row in ROWS} == {state.name for state in DriveState}


def drive(state: State, target: PowerTarget, ticks: int, reset: bool = False) -> list[State]:
    """States that an independent drive goes through under our controlwords."""
    path, previous = [state], 0
    for _ in range(ticks):
        word = controlword(drive_state(path[-1].value), target, previous, reset)
        path.append(on_controlword(path[-1], previous, word, 6))
        previous = word
    return path


LIVE = [s for s in State if s not in (State.NOT_READY_TO_SWITCH_ON, State.FAULT_REACTION_ACTIVE)]


@pytest.mark.parametrize(("state", "target"), list(itertools.product(LIVE, PowerTarget)))
def test_a_drive_gets_to_the_target_and_stays(state, target):
    path = drive(state, target, ticks=6, reset=True)
    assert drive_status(path[-1].value).condition.reached(target)
    assert path[-1] is path[-2]


@pytest.mark.parametrize("state", list(State))
def test_only_on_ever_energises_a_drive(state):
    torque = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
    for target in (OFF, STOP):
        path = drive(state, target, ticks=6, reset=True)
        assert not any(b in torque and a not in torque for a, b in itertools.pairwise(path))


def test_quick_stop_keeps_the_torque_of_a_drive_in_operation():
    path = drive(State.OPERATION_ENABLED, STOP, ticks=5)
    assert path[1:] == [State.QUICK_STOP_ACTIVE] * 5


@pytest.mark.parametrize("target", list(PowerTarget))
def test_a_fault_stays_unless_reset_is_asked(target):
    assert drive(State.FAULT, target, ticks=5) == [State.FAULT] * 6
    assert drive(State.FAULT, target, ticks=1, reset=True)[-1] is State.SWITCH_ON_DISABLED


def test_a_reset_held_is_an_edge_every_other_tick():
    words, previous = [], 0
    for _ in range(6):
        previous = controlword(DriveState.FAULT, ON, previous, reset=True)
        words.append(previous)
    assert words == [FAULT_RESET, 0, FAULT_RESET, 0, FAULT_RESET, 0]


@pytest.mark.parametrize("state", [s for s in DriveState if s is not DriveState.FAULT])
def test_reset_means_nothing_outside_a_fault(state):
    for target in PowerTarget:
        assert controlword(state, target, 0, reset=True) == controlword(state, target, 0)


def test_reached():
    without_torque = {"NOT_READY_TO_SWITCH_ON", "SWITCH_ON_DISABLED", "READY_TO_SWITCH_ON", "FAULT"}
    for target, wanted in (
        (OFF, without_torque),
        (ON, {"OPERATION_ENABLED"}),
        (STOP, without_torque | {"SWITCHED_ON", "QUICK_STOP_ACTIVE"}),
    ):
        found = {state.name for state, each in CONDITION_OF.items() if each.reached(target)}
        assert found == wanted


def test_a_status_holds_what_the_daemon_asks_for():
    assert set(CONDITION_OF) == set(DriveState)
    powered = {state.name for state, condition in CONDITION_OF.items() if condition.powered}
    on = {"OPERATION_ENABLED", "QUICK_STOP_ACTIVE", "FAULT_REACTION_ACTIVE", "UNKNOWN"}
    assert powered == on
    faults = {state.name for state, condition in CONDITION_OF.items() if condition.in_fault}
    assert faults == {"FAULT", "FAULT_REACTION_ACTIVE"}
    for word, supplied, following in ((0x0027, False, False), (0x1037, True, True)):
        status = drive_status(word)
        assert (status.supplied, status.following) == (supplied, following)
        assert status.detail == f"operation enabled (statusword 0x{word:04X})"
    assert (drive_status(-1).supplied, drive_status(-1).following) == (None, False)
