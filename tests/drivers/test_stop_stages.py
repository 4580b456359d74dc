"""Stages of a stop: what counts as a proof, and what happens without one."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia402 import UNPOWERED, DriveState, PowerTarget
from drivers.stop_stages import (
    BRAKE_S,
    OBEYING,
    READING_TICKS,
    STILL_S,
    SWINGS_S,
    VOID_READINGS,
    Seen,
    Stage,
    StopBounds,
    StopWatch,
    least_patience_s,
    stage_ticks,
    worst_travel,
)
from tests.examples import scaled

T = 0.01
ON, STOPS = DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE
STOP, OFF = PowerTarget.QUICK_STOP, PowerTarget.OFF
BOUNDS = StopBounds(
    deceleration=10.0, current=2.0, travel=0.24, patience_s=0.1, ticks=3, period_s=T
)
RUNS = Seen(ON, 1.0, 0.0, 0.0)


def told(speed: float = 0.0, stage: Stage = Stage.SETPOINT, position: float = 0.0) -> StopWatch:
    watch = StopWatch(BOUNDS)
    watch.begin(0.0, stage, speed, position)
    return watch


def stages(watch: StopWatch, seen: Seen | None, ticks: int, target: PowerTarget = STOP) -> dict:
    """Tick -> stage that began in it; every tick shows the same. The first tick tells it."""
    found = {k: watch.step(k * T, target, seen) for k in range(ticks + 1)}
    return {k: stage for k, stage in found.items() if stage is not None}


@pytest.mark.parametrize("state", sorted(UNPOWERED))
def test_without_power_it_stands_when_it_is_seen_to(state: DriveState) -> None:
    watch = told()
    for k in (1, 2):
        assert watch.unproved
        assert watch.step(k * T, STOP, Seen(state, 0.0)) is None
    assert watch.proved
    assert not watch.unproved


@pytest.mark.parametrize(
    ("seen", "proved"),
    [
        (Seen(STOPS, 0.0), True),
        (Seen(STOPS, -0.019), True),
        (Seen(STOPS, 0.021), False),
        (Seen(STOPS, math.nan), False),
        (Seen(DriveState.SWITCH_ON_DISABLED, 1.2), False),
        (Seen(DriveState.SWITCH_ON_DISABLED, math.nan), False),
        (Seen(ON, 0.0), False),
        (Seen(DriveState.UNKNOWN, 0.0), False),
        (Seen(DriveState.FAULT_REACTION_ACTIVE, 0.0), True),
        (None, False),
    ],
)
def test_what_proves_that_it_stands(seen: Seen | None, proved: bool) -> None:
    watch = told()
    watch.step(T, STOP, seen)
    assert not watch.proved, "once is noise"
    watch.step(2 * T, STOP, seen)
    assert watch.proved is proved


def test_a_velocity_with_a_bias_is_no_motion_where_the_position_stays() -> None:
    watch = told()
    for k in range(1, 30):
        watch.step(k * T, STOP, Seen(STOPS, 0.03, 0.0, position=0.5 + 0.0001 * k))
        assert watch.proved is (k >= round(STILL_S / T) + 3), k


@pytest.mark.parametrize("speed", [0.03, 0.5])
def test_who_creeps_or_runs_is_not_still(speed: float) -> None:
    watch = told(speed)
    for k in range(1, 200):
        watch.step(k * T, STOP, Seen(STOPS, speed, 0.0, position=speed * k * T))
        assert not watch.proved


@pytest.mark.parametrize("seen", [None, RUNS, Seen(DriveState.UNKNOWN, 0.0)])
def test_without_a_proof_it_is_told_more_strongly_each_time(seen: Seen | None) -> None:
    # Slow enough for its travel to last: three ticks, then six, then nine.
    slow = seen and Seen(seen.state, 0.1, 0.0, 0.0)
    assert stages(told(0.1), slow, 30) == {3: Stage.SDO, 9: Stage.NMT, 18: Stage.SILENCE}


@pytest.mark.parametrize(
    ("stage", "next_stage"), [(Stage.SETPOINT, Stage.SDO), (Stage.SDO, Stage.NMT)]
)
def test_a_drive_that_waits_for_its_brake_has_a_second(stage: Stage, next_stage: Stage) -> None:
    begun = stages(told(stage=stage), Seen(ON, 0.0), round(BRAKE_S / T) + 5, OFF)
    assert begun == {round(BRAKE_S / T): next_stage}


@pytest.mark.parametrize("seen", [None, RUNS])
def test_at_full_speed_silence_comes_while_the_travel_still_suffices(seen: Seen | None) -> None:
    """0.24 rad, less 0.1 for the drives' patience and 0.05 of braking, at 1 rad/s."""
    watch = told(1.0)
    found = {}
    for k in range(30):
        here = seen and Seen(ON, 1.0, 0.0, position=k * T)
        if stage := watch.step(k * T, STOP, here):
            found[k] = stage
    assert found == {3: Stage.SDO, 6: Stage.NMT, 9: Stage.SILENCE}


def course(velocity_at, current: float = 0.0, ticks: int = 100) -> tuple[StopWatch, list[Stage]]:
    """Of a drive in quick stop, from 1 rad/s."""
    watch, begun, position = told(1.0), [], 0.0
    for k in range(1, ticks):
        velocity = velocity_at(k * T)
        position += velocity * T
        if stage := watch.step(k * T, STOP, Seen(STOPS, velocity, current, position)):
            begun.append(stage)
    return watch, begun


@pytest.mark.parametrize(
    ("velocity_at", "current", "runs_on"),
    [
        (lambda t: max(1.0 - 10.0 * t, 0.05), 0.0, False),  # as configured, then in its gap
        (lambda t: max(1.0 - 6.0 * t, 0.05), 0.0, False),  # with a load that pulls
        (lambda t: 1.0, 0.0, True),
        (lambda t: 1.0, 1.5, True),  # by its own power
        (lambda t: 1.0, -1.1, False),  # somebody is stronger
        (lambda t: 1.3 * 0.95 ** (t / T), 0.0, False),  # knocked, it slows down by itself
    ],
)
def test_a_drive_that_says_so_and_runs_on_is_told_of(velocity_at, current, runs_on) -> None:
    watch, begun = course(velocity_at, current, ticks=60)
    assert watch.runs_on is runs_on
    assert watch.cut is runs_on, "0.59 rad, of 0.24"
    assert begun == [], (
        "a stronger stage asks nothing else of it, and costs the others their master"
    )


def test_a_drive_that_says_so_keeps_its_power_within_its_travel() -> None:
    within = round(BOUNDS.travel / T)  # ticks, at 1 rad/s; the first tells it
    for ticks, cut in ((within + BOUNDS.ticks - 1, False), (within + BOUNDS.ticks + 1, True)):
        watch, begun = course(lambda t: 1.0, ticks=ticks)
        assert (watch.runs_on, watch.cut, begun) == (True, cut, []), ticks


def test_without_power_it_is_proved_like_any_other_and_free_when_it_may_run() -> None:
    watch, _ = course(lambda t: 1.0)
    assert watch.cut
    for k in range(100, 110):
        assert watch.step(k * T, STOP, Seen(DriveState.SWITCH_ON_DISABLED, 0.0, 0.0, 1.0)) is None
    assert watch.proved
    assert watch.cut, "until it may run"
    watch.allow()
    assert not watch.cut


@pytest.mark.parametrize("hertz", [1.5, 2.0, 3.0, 5.0])
def test_a_hand_that_works_at_a_joint_that_stops_leads_to_nothing(hertz: float) -> None:
    watch, begun = course(lambda t: 0.9 * math.cos(2 * math.pi * hertz * t), ticks=300)
    assert begun == []
    assert not watch.cut
    assert not watch.proved


def test_a_link_that_swings_in_its_gap_has_a_second() -> None:
    watch, _ = course(lambda t: 0.06, ticks=round((1.0 / 5.0 + SWINGS_S) / T))
    assert not watch.runs_on
    watch, _ = course(lambda t: 0.06, ticks=round((1.0 / 5.0 + SWINGS_S) / T) + 2 * VOID_READINGS)
    assert watch.runs_on


def test_samples_lost_in_a_burst_are_no_doubt_of_a_drive_that_was_seen_to_brake() -> None:
    for burst in (5, 8, 10):
        watch = told(1.0)
        watch.step(T, STOP, RUNS)
        for k in range(2, 5):
            watch.step(k * T, STOP, Seen(STOPS, 1.0 - 10.0 * (k - 1) * T, 0.0, k * T))
        for k in range(5, 5 + burst):
            assert watch.step(k * T, STOP, None) is None


def test_a_drive_that_stood_and_runs_on_by_itself_is_not_proved_any_more() -> None:
    watch = told()
    for k in (1, 2):
        watch.step(k * T, STOP, Seen(STOPS, 0.0, 0.0, 0.0))
    assert watch.proved
    for k in range(200):
        watch.step(2.0 + k * T, STOP, Seen(STOPS, 0.3, 0.1, 0.3 * k * T))
    assert watch.runs_on
    assert watch.unproved


def test_what_was_proved_is_void_when_it_runs_again() -> None:
    watch = told()
    for k in (1, 2):
        watch.step(k * T, STOP, Seen(STOPS, 0.0))
    for k in range(3, 50):
        assert watch.step(k * T, STOP, None) is None, "its silence is no news"
    assert watch.proved
    assert watch.step(0.5, STOP, RUNS) is None
    assert watch.unproved
    assert watch.stage is Stage.SETPOINT


def test_it_is_free_again_when_it_may_run() -> None:
    watch = told(stage=Stage.NMT)
    watch.allow()
    assert (watch.stage, watch.unproved) == (Stage.NONE, False)


def test_the_travel_of_a_joint(joint_drives) -> None:
    travel = worst_travel(joint_drives, T, noticing_ticks=3)[0]
    assert travel.noticing == pytest.approx(0.03)  # 1 rad/s for three ticks of 10 ms
    assert travel.stages == pytest.approx(0.09)  # three ticks each
    assert travel.patience == 0.1  # 100 ms
    assert travel.braking == 0.05  # 1 / (2 * 10)
    assert travel.total == pytest.approx(0.27)
    assert least_patience_s(joint_drives) == 0.1


@pytest.mark.parametrize(
    ("patience_s", "period_s", "ticks"),
    [(0.1, 0.01, 3), (0.12, 0.01, 4), (0.1, 0.001, 33), (0.03, 0.01, 3), (0.09, 0.01, 3)],
)
def test_the_stages_take_the_drives_patience_and_leave_them_time_to_answer(
    patience_s: float, period_s: float, ticks: int
) -> None:
    assert stage_ticks(patience_s, period_s) == ticks


@pytest.mark.parametrize(
    ("pattern", "begins"), [("w", 3), ("wwo", 5), ("wo", None), ("wooo", None), ("o", None)]
)
def test_one_good_tick_takes_one_bad_tick_away_and_no_more(
    pattern: str, begins: int | None
) -> None:
    wrong, right = Seen(ON, 0.0, 0.0, 0.0), Seen(STOPS, 0.05, 0.0, 0.0)
    watch = told(0.05)
    begun = [
        k
        for k in range(1, 60)
        if watch.step(k * T, STOP, wrong if (pattern * 60)[k - 1] == "w" else right)
    ]
    assert (begun[0] if begun else None) == begins


def test_a_reading_holds_for_ten_ticks() -> None:
    watch = told(0.05)
    assert watch.step(T, STOP, Seen(STOPS, 0.05)) is None
    silent = {k: stage for k in range(2, 20) if (stage := watch.step(k * T, STOP, None))}
    assert min(silent) == 1 + READING_TICKS + 3


def test_a_late_tick_is_no_more_than_two_bad_ones() -> None:
    watch = told()
    assert watch.step(0.5, STOP, None) is None
    assert watch.step(0.51, STOP, None) is Stage.SDO


def test_what_was_proved_begins_with_nothing_against_it() -> None:
    watch = told()
    for k in (1, 2):
        watch.step(k * T, STOP, RUNS)
    for k in (3, 4):
        watch.step(k * T, STOP, Seen(STOPS, 0.0))
    assert watch.proved
    begun = {k: s for k in range(5, 12) if (s := watch.step(k * T, STOP, Seen(ON, 0.0, 0, 0)))}
    assert min(begun) == 5 + 2, "three ticks, the first of which says so"


SEEN = st.none() | st.builds(
    Seen,
    st.sampled_from(DriveState),
    st.floats(-3.0, 3.0) | st.just(math.nan),
    st.floats(-2.0, 2.0) | st.just(math.nan),
    st.floats(-1.0, 1.0) | st.just(math.nan),
)


@settings(max_examples=scaled(200))
@given(ticks=st.lists(st.tuples(SEEN, st.floats(0.001, 3.0)), max_size=40))
def test_it_is_proved_by_nothing_but_a_reading_and_never_gets_weaker(ticks) -> None:
    watch, now = told(), 0.0
    for seen, dt in ticks:
        before, proved, now = watch.stage, watch.proved, now + dt
        watch.step(now, STOP, seen)
        if watch.proved and not proved:
            assert seen is not None
            assert seen.state in OBEYING
        if proved and not watch.proved:
            assert seen is not None
        elif not (proved or watch.proved):
            assert watch.stage >= before


@settings(max_examples=scaled(100))
@given(speed=st.floats(0.0, 1.0), seen=SEEN.filter(lambda s: s is None or s.state is ON))
def test_a_drive_that_never_obeys_ends_in_silence_in_time(speed: float, seen: Seen | None) -> None:
    watch = told(speed)
    begun = stages(watch, seen, 18)
    assert watch.stage is Stage.SILENCE, begun
