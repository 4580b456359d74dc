"""Table of transitions, exhaustively: every mode with every event."""

from itertools import product

import pytest

from daemon.modes.machine import ModeMachine
from daemon.modes.table import (
    ARMABLE,
    DISARMING,
    ENERGISED,
    GUIDED,
    REFUSALS,
    SENSING,
    TRANSITIONS,
    Event,
    Mode,
    next_mode,
)

ALL = list(product(Mode, Event))
PRESENT = sorted(TRANSITIONS)
ABSENT = sorted(set(ALL) - set(TRANSITIONS))
COMMANDS = set(map(Event, ("enable", "start", "pause", "stop", "disarm", "disable", "reset")))
DISARMS = {
    *(Event.DISARM, Event.STOP, Event.DISABLE, Event.BOUND, Event.TIMEOUT, Event.DOUBT),
    *(Event.FAULT, Event.RESET),
}
MOVING = [Mode.TRACKING, *sorted(GUIDED)]


def machine_in(mode: Mode, *, armed: bool = False, moving: bool = False) -> ModeMachine:
    """A machine that is in the mode since 1 s."""
    machine = ModeMachine()
    machine.mode, machine.armed, machine.moving = mode, armed, moving
    machine.cause, machine.entered_s = "before", 1.0
    return machine


def modes_but(*left_out: Mode) -> list[Mode]:
    return sorted(set(Mode) - set(left_out))


def into(mode: Mode, target: Mode) -> list[Event]:
    """Events that lead from a mode to the target."""
    return [event for event in Event if next_mode(mode, event) is target]


def seen(machine: ModeMachine) -> tuple[object, ...]:
    return machine.mode, machine.armed, machine.moving, machine.cause, machine.entered_s


@pytest.mark.parametrize(("mode", "event"), PRESENT)
def test_a_row_is_followed(mode: Mode, event: Event) -> None:
    machine = machine_in(mode)
    after = TRANSITIONS[mode, event]
    assert machine.can(event)
    assert machine.apply(event, "why", 2.0)
    assert machine.mode is after is next_mode(mode, event)
    changed = after is not mode
    assert machine.cause == ("why" if changed else "before")
    assert machine.entered_s == (2.0 if changed else 1.0)
    lines = [(change.text, change.cause) for change in machine.changes]
    assert lines == ([(f"{mode} -> {after}", "why")] if changed else [])


@pytest.mark.parametrize("flag", [False, True])
@pytest.mark.parametrize(("mode", "event"), ABSENT)
def test_an_event_without_a_row_changes_nothing(mode: Mode, event: Event, flag: bool) -> None:
    machine = machine_in(mode, armed=flag, moving=flag)
    before = seen(machine)
    assert not machine.can(event)
    assert not machine.apply(event, "why", 2.0)
    assert seen(machine) == before
    assert not machine.changes


@pytest.mark.parametrize(("mode", "event"), PRESENT)
def test_which_events_disarm(mode: Mode, event: Event) -> None:
    machine = machine_in(mode, armed=True)
    machine.apply(event, "why", 2.0)
    assert machine.armed is (event not in DISARMS)
    assert ("disarmed" in [change.text for change in machine.changes]) is (event in DISARMS)


def test_the_disarming_events_are_these() -> None:
    assert DISARMING == DISARMS


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("event", [Event.STOP, Event.DISARM])
def test_stop_and_disarm_work_in_every_mode(mode: Mode, event: Event) -> None:
    machine = machine_in(mode, armed=True)
    assert machine.apply(event, "a person", 2.0)
    assert not machine.armed
    assert machine.mode is not Mode.TRACKING or event is Event.DISARM
    assert machine.mode not in GUIDED


@pytest.mark.parametrize(
    ("mode", "event", "after"),
    [
        *((mode, Event.FAULT, {Mode.FAULTED}) for mode in modes_but(Mode.FAULTED)),
        *((mode, Event.DISABLE, {Mode.OFF, Mode.STOPPING}) for mode in modes_but(Mode.FAULTED)),
        *((mode, Event.DOUBT, {Mode.STOPPING}) for mode in (*MOVING, Mode.RELEASING)),
    ],
)
def test_fault_disable_and_doubt_end_motion(mode: Mode, event: Event, after: set[Mode]) -> None:
    assert next_mode(mode, event) in after


@pytest.mark.parametrize("mode", [Mode.HOLDING, Mode.STOPPING])
def test_doubt_disarms_an_arm_that_holds_or_stops(mode: Mode) -> None:
    machine = machine_in(mode, armed=True)
    assert machine.apply(Event.DOUBT, "the test", 2.0)
    assert (machine.mode, machine.armed) == (mode, False)


@pytest.mark.parametrize("mode", Mode)
def test_disarm_stops_a_guided_arm_alone(mode: Mode) -> None:
    assert next_mode(mode, Event.DISARM) is (Mode.STOPPING if mode in GUIDED else mode)


@pytest.mark.parametrize("mode", sorted(set(Mode) - ENERGISED))
def test_only_enable_energises(mode: Mode) -> None:
    into = [event for event in Event if next_mode(mode, event) in ENERGISED]
    assert into == ([Event.ENABLE] if mode is Mode.OFF else [])


@pytest.mark.parametrize("mode", modes_but(Mode.TRACKING))
def test_only_start_and_quiet_begin_a_trajectory(mode: Mode) -> None:
    expected = {
        Mode.HOLDING: [Event.START],
        Mode.ADMITTANCE: [Event.RESUME],
        Mode.RETRACTING: [Event.RESUME],
        Mode.RETURNING: [Event.ARRIVED],
    }
    assert into(mode, Mode.TRACKING) == expected.get(mode, [])


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    ("guided", "event"), [(Mode.ADMITTANCE, Event.TOUCH), (Mode.RETRACTING, Event.RETRACT)]
)
def test_only_a_contact_makes_it_yield_or_retract(mode: Mode, guided: Mode, event: Event) -> None:
    # It may back away again; yielding again is no change, and a release comes first.
    felt = mode in SENSING - {Mode.RELEASING} and not mode is guided is Mode.ADMITTANCE
    paused = [Event.PAUSE, Event.ABANDON] if mode is guided else []
    assert into(mode, guided) == paused + ([event] if felt else [])


@pytest.mark.parametrize("mode", modes_but(Mode.RELEASING))
def test_only_a_collision_begins_a_release(mode: Mode) -> None:
    felt = mode in SENSING - {Mode.ADMITTANCE}  # where it yields already
    assert into(mode, Mode.RELEASING) == ([Event.RELEASE] if felt else [])


def test_a_trajectory_needs_a_new_start_after_a_collision() -> None:
    machine = machine_in(Mode.TRACKING, moving=True)
    machine.apply(Event.RELEASE, "hit", 2.0)
    assert machine.trajectory == "paused"
    machine.apply(Event.DISARM, "a program", 2.1)  # a release needs no permission
    assert machine.mode is Mode.RELEASING
    machine.apply(Event.HALT, "let go", 2.5)
    machine.apply(Event.STANDSTILL, "stands", 2.6)
    assert (machine.mode, machine.trajectory) == (Mode.HOLDING, "paused")


@pytest.mark.parametrize("mode", Mode)
def test_only_the_quiet_time_begins_a_return(mode: Mode) -> None:
    guided = mode in (Mode.ADMITTANCE, Mode.RETRACTING)
    assert into(mode, Mode.RETURNING) == ([Event.RETURN] if guided else [])


@pytest.mark.parametrize("mode", modes_but(Mode.HOLDING, Mode.OFF, Mode.ENABLING, Mode.FAULTED))
def test_a_halt_stops_a_moving_arm(mode: Mode) -> None:
    machine = machine_in(mode)
    machine.apply(Event.HALT, "hit", 2.0)
    assert machine.mode is Mode.STOPPING


def test_only_reset_ends_a_fault() -> None:
    leaving = [event for event in Event if next_mode(Mode.FAULTED, event) not in (None, "faulted")]
    assert leaving == [Event.RESET]
    assert next_mode(Mode.FAULTED, Event.RESET) is Mode.OFF


def test_motion_never_ends_by_cutting_power() -> None:
    for mode in (*MOVING, Mode.STOPPING):
        for event in Event:
            assert next_mode(mode, event) not in (Mode.OFF, Mode.ENABLING), (mode, event)


@pytest.mark.parametrize("mode", [*MOVING, Mode.STOPPING])
def test_disable_in_motion_stops_first_and_then_goes_off(mode: Mode) -> None:
    machine = machine_in(mode, armed=True, moving=True)
    assert machine.apply(Event.DISABLE, "a person", 2.0)
    assert machine.mode is Mode.STOPPING
    machine.apply(Event.STOP, "a person", 2.1)  # does not cancel `disable`
    machine.changes.clear()
    assert machine.apply(Event.STANDSTILL, "stands", 2.5)
    assert machine.mode is Mode.OFF
    assert not machine.armed
    assert [c.text for c in machine.changes] == ["stopping -> holding", "holding -> off"]
    for event in (Event.ENABLE, Event.ENERGISED):  # it is done once
        machine.apply(event, "again", 3.0)
    assert machine.mode is Mode.HOLDING


def test_a_fault_cancels_a_disable() -> None:
    machine = machine_in(Mode.TRACKING)
    machine.apply(Event.DISABLE, "a person", 2.0)
    for event in (Event.FAULT, Event.RESET, Event.ENABLE, Event.ENERGISED):
        assert machine.apply(event, "then", 3.0)
    assert machine.mode is Mode.HOLDING


@pytest.mark.parametrize(("mode", "event"), PRESENT)
def test_a_trajectory_goes_on_only_after_a_contact(mode: Mode, event: Event) -> None:
    machine = machine_in(mode, moving=mode in MOVING)
    machine.apply(event, "why", 2.0)
    paused = event in (Event.PAUSE, Event.ABANDON)
    goes_on = machine.mode in GUIDED and mode in MOVING and not paused
    assert machine.moving is (machine.mode is Mode.TRACKING or goes_on)


def test_a_contact_while_holding_continues_no_trajectory() -> None:
    machine = machine_in(Mode.HOLDING, armed=True)
    machine.apply(Event.TOUCH, "touch", 2.0)
    assert (machine.mode, machine.moving) == (Mode.ADMITTANCE, False)


def test_arming_twice_is_reported_once() -> None:
    machine = ModeMachine()
    machine.arm("a person")
    machine.arm("another")
    assert machine.armed
    assert [(c.text, c.cause) for c in machine.changes] == [("armed", "a person")]


def test_a_machine_starts_off_and_disarmed() -> None:
    machine = ModeMachine()
    assert (machine.mode, machine.armed, machine.moving) == (Mode.OFF, False, False)


def test_every_mode_is_reached_and_every_event_used() -> None:
    reached, frontier = {Mode.OFF}, {Mode.OFF}
    while frontier:
        frontier = {TRANSITIONS[m, e] for m, e in PRESENT if m in frontier} - reached
        reached |= frontier
    assert reached == set(Mode)
    assert {event for _, event in PRESENT} == set(Event)


def test_modes_and_words_are_complete() -> None:
    assert set(REFUSALS) == set(Mode)
    assert ARMABLE < SENSING < ENERGISED
    assert not {Mode.OFF, Mode.FAULTED} & ENERGISED
    assert all((Mode.FAULTED, e) not in TRANSITIONS for e in COMMANDS - DISARMS)


@pytest.mark.parametrize("armed", [False, True])
@pytest.mark.parametrize("mode", [m for m in Mode if next_mode(m, Event.PAUSE)])
def test_abandon_halts_as_pause_and_forgets_the_trajectory(mode: Mode, armed: bool) -> None:
    machine, paused = machine_in(mode, armed=armed), machine_in(mode, armed=armed)
    machine.paused = paused.paused = True
    machine.apply(Event.ABANDON, "why", 2.0)
    paused.apply(Event.PAUSE, "why", 2.0)
    assert (machine.mode, machine.armed) == (paused.mode, armed)
    assert (machine.trajectory, paused.trajectory) == ("ready", "paused")
    assert machine.cause.endswith("why")
    assert machine.changes[-1].cause == "why"


def test_the_state_of_the_trajectory_after_each_event() -> None:
    machine = machine_in(Mode.HOLDING, armed=True)
    reported = [machine.trajectory]
    for event in (
        *(Event.START, Event.TOUCH, Event.RESUME, Event.PAUSE, Event.STANDSTILL, Event.TOUCH),
        *(Event.SETTLE, Event.START, Event.END, Event.START, Event.PAUSE, Event.STOP),
    ):
        assert machine.apply(event, "why", 2.0)
        reported.append(machine.trajectory)
    assert reported == [
        "ready",
        *("running", "interrupted", "running", "paused", "paused", "paused"),
        *("paused", "running", "ready", "running", "paused", "ready"),
    ]
