"""From samples to findings."""

import numpy as np
import pytest

from daemon.modes import SENSING, Mode
from daemon.observation import Observer
from daemon.supervisor import Condition, Reaction
from drivers.cia402 import DriveState
from drivers.events import (
    BadSetpoint,
    BusTrouble,
    Emergency,
    Event,
    ForeignMaster,
    HeartbeatLost,
    NotOperational,
    Rebooted,
)
from drivers.samples import Samples

NAMES = ("shoulder", "elbow")
ON = DriveState.OPERATION_ENABLED


def samples(
    *events: Event,
    fresh: tuple[bool, bool] = (True, True),
    age: tuple[int, int] = (0, 0),
    states: tuple[DriveState, DriveState] = (ON, ON),
) -> Samples:
    zero = np.zeros(2)
    return Samples(
        zero, zero, zero, None, np.array(fresh), np.array(age), list(states), [0, 0], events
    )


def observe(
    observer: Observer,
    taken: Samples,
    mode: Mode = Mode.TRACKING,
    late: bool = False,
    finite: bool = True,
) -> list[tuple[Condition, str]]:
    return [(f.condition, f.text) for f in observer.findings(taken, mode, late, finite)]


@pytest.fixture
def observer() -> Observer:
    return Observer(NAMES, stale_ticks=3, overrun_ticks=5)


@pytest.mark.parametrize("mode", SENSING)
def test_an_undisturbed_tick_finds_nothing(observer: Observer, mode: Mode) -> None:
    assert observe(observer, samples(), mode) == []


@pytest.mark.parametrize(
    ("event", "condition"),
    [
        (HeartbeatLost(3), Condition.HEARTBEAT_LOST),
        (Emergency(3, 0x8130, 0x11), Condition.EMERGENCY),
        (Rebooted(3), Condition.REBOOTED),
        (NotOperational(3, 127), Condition.DRIVE_DROPPED),
        (ForeignMaster(0x080), Condition.FOREIGN_MASTER),
        (BadSetpoint("elbow: nan"), Condition.NOT_FINITE),
    ],
)
def test_an_event_of_the_bus(observer: Observer, event: Event, condition: Condition) -> None:
    assert observe(observer, samples(event)) == [(condition, str(event))]


def test_an_emergency_that_is_over_is_none(observer: Observer) -> None:
    assert observe(observer, samples(Emergency(3, 0, 0))) == []


def test_bus_trouble_counts_when_it_lasts(observer: Observer) -> None:
    trouble = samples(BusTrouble("error frame: bus error"))
    assert observe(observer, trouble) == observe(observer, trouble) == []
    assert observe(observer, trouble) == [(Condition.BUS_TROUBLE, "error frame: bus error")]
    assert observe(observer, samples()) == []
    assert observe(observer, trouble) == []  # counted from the start again


def test_missing_samples_are_named_and_stale_after_a_while(observer: Observer) -> None:
    missing = samples(fresh=(True, False), age=(0, 2))
    assert observe(observer, missing) == [(Condition.SAMPLE_MISSING, "elbow")]
    stale = samples(fresh=(False, False), age=(1, 3))
    assert observe(observer, stale) == [(Condition.STALE, "nothing from elbow for 3 ticks")]


@pytest.mark.parametrize("mode", Mode)
def test_a_drive_in_fault_is_found_in_every_mode(observer: Observer, mode: Mode) -> None:
    for state in (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE):
        taken = samples(states=(ON, state))
        assert observe(observer, taken, mode) == [(Condition.DRIVE_FAULT, "elbow")]


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    "state", set(DriveState) - {ON, DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE}
)
def test_a_drive_that_drops_out_is_found_while_it_should_run(
    observer: Observer, mode: Mode, state: DriveState
) -> None:
    words = state.name.lower().replace("_", " ")
    expected = [(Condition.DRIVE_DROPPED, f"shoulder is in {words}")] if mode in SENSING else []
    assert observe(observer, samples(states=(state, ON)), mode) == expected


def test_late_ticks_become_an_overrun_in_a_row(observer: Observer) -> None:
    for _ in range(4):
        assert observe(observer, samples(), late=True) == [(Condition.LATE, "")]
    assert observe(observer, samples(), late=True) == [(Condition.OVERRUN, "5 in a row")]
    assert observe(observer, samples(), late=True) == [(Condition.OVERRUN, "6 in a row")]
    assert observe(observer, samples()) == []
    assert observe(observer, samples(), late=True) == [(Condition.LATE, "")]


def test_samples_that_are_not_finite(observer: Observer) -> None:
    assert observe(observer, samples(), finite=False)[0][0] is Condition.NOT_FINITE


def test_everything_at_once_is_listed(observer: Observer) -> None:
    taken = samples(
        HeartbeatLost(2), fresh=(True, False), age=(0, 9), states=(DriveState.FAULT, ON)
    )
    findings = observer.findings(taken, Mode.TRACKING, late=True, finite=False)
    assert [f.condition for f in findings] == [
        Condition.HEARTBEAT_LOST,
        Condition.STALE,
        Condition.DRIVE_FAULT,
        Condition.LATE,
        Condition.NOT_FINITE,
    ]
    assert max(f.reaction for f in findings) is Reaction.QUICK_STOP
