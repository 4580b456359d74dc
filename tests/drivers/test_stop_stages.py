"""Stages of a stop: what counts as a proof, and what happens without one."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia402 import UNPOWERED, DriveState, PowerTarget
from drivers.stop_stages import (
    BRAKE_S,
    SWINGS_S,
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
def test_without_power_it_stands(state: DriveState) -> None:
    watch = told()
    assert watch.unproved
    assert watch.step(T, STOP, Seen(state, math.nan)) is None
    assert watch.proved
    assert not watch.unproved


@pytest.mark.parametrize(
    ("seen", "proved"),
    [
        (Seen(STOPS, 0.0), True),
        (Seen(STOPS, -0.019), True),
        (Seen(STOPS, 0.021), False),
        (Seen(STOPS, math.nan), False),
        (Seen(ON, 0.0), False),
        (Seen(DriveState.UNKNOWN, 0.0), False),
        (Seen(DriveState.FAULT_REACTION_ACTIVE, 0.0), False),
        (None, False),
    ],
)
def test_what_proves_that_it_stands(seen: Seen | None, proved: bool) -> None:
    watch = told()
    watch.step(T, STOP, seen)
    assert watch.proved is proved


@pytest.mark.parametrize("seen", [None, RUNS, Seen(DriveState.UNKNOWN, 0.0)])
def test_without_a_proof_it_is_told_more_strongly_each_time(seen: Seen | None) -> None:
    # Slow enough for its travel to last: three ticks, then six, then nine.
    slow = seen and Seen(seen.state, 0.1, 0.0, 0.0)
    assert stages(told(0.1), slow, 30) == {3: Stage.SDO, 9: Stage.NMT, 18: Stage.SILENCE}


def test_a_drive_that_waits_for_its_brake_has_a_second() -> None:
    assert stages(told(), Seen(ON, 0.0), 110, OFF) == {
        round(BRAKE_S / T): Stage.SDO,
        106: Stage.NMT,
    }


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


def test_a_lost_sample_is_no_doubt() -> None:
    watch = told(0.3)
    for k in range(1, 20):
        seen = Seen(STOPS, 0.05) if k % 3 == 1 else None
        assert watch.step(k * T, STOP, seen) is None
    assert watch.stage is Stage.SETPOINT


def test_it_must_fall_along_the_ramp() -> None:
    def follow(velocity_at) -> dict:
        watch = told(1.0)
        return {
            k: stage
            for k in range(1, 25)
            if (stage := watch.step(k * T, STOP, Seen(STOPS, velocity_at(k * T))))
        }

    assert follow(lambda t: max(1.0 - 10.0 * t, 0.0)) == {}, "as configured"
    assert follow(lambda t: max(1.0 - 6.0 * t, 0.0)) == {}, "with a load that pulls"
    runs_on = follow(lambda t: 1.0)
    stronger = [Stage.SDO, Stage.NMT, Stage.SILENCE]
    assert list(runs_on.values()) == stronger, "it says that it stops, and runs on"
    assert min(runs_on) == 6, "seen in tick 1; 20 ms later the ramp must show, for three ticks"


def test_who_pushes_harder_than_it_brakes_is_no_disobedience() -> None:
    watch = told(0.5)
    for k in range(1, 60):  # the motor resists with more than half its current
        assert watch.step(k * T, STOP, Seen(STOPS, 0.5, current=-1.1)) is None
    for k in range(60, 90):  # knocked the other way, it slows down by itself
        assert watch.step(k * T, STOP, Seen(STOPS, -1.3 * 0.9 ** (k - 60), current=0.1)) is None
    assert not watch.proved


def test_a_link_that_swings_in_its_gap_has_a_second() -> None:
    watch = told(0.1)
    begun = {
        k: stage
        for k in range(1, 200)
        if (stage := watch.step(k * T, STOP, Seen(STOPS, 0.06, current=0.0)))
    }
    assert round(SWINGS_S / T) < min(begun) < round((SWINGS_S + 0.2) / T)


def test_what_was_proved_is_void_when_it_runs_again() -> None:
    watch = told()
    watch.step(T, STOP, Seen(STOPS, 0.0))
    for k in range(2, 50):
        assert watch.step(k * T, STOP, None) is None, "its silence is no news"
    assert watch.proved
    assert watch.step(0.5, STOP, RUNS) is None
    assert watch.unproved
    assert watch.stage is Stage.SETPOINT


def test_it_is_free_again_when_it_may_run() -> None:
    watch = told(stage=Stage.NMT)
    watch.release()
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


def test_a_reading_holds_for_two_ticks() -> None:
    watch = told(0.05)
    assert watch.step(T, STOP, Seen(STOPS, 0.05)) is None
    silent = {k: stage for k in range(2, 9) if (stage := watch.step(k * T, STOP, None))}
    assert min(silent) == 1 + 2 + 3


def test_a_late_tick_is_no_more_than_two_bad_ones() -> None:
    watch = told()
    assert watch.step(0.5, STOP, None) is None
    assert watch.step(0.51, STOP, None) is Stage.SDO


def test_what_was_proved_begins_with_nothing_against_it() -> None:
    watch = told()
    for k in (1, 2):
        watch.step(k * T, STOP, RUNS)
    watch.step(3 * T, STOP, Seen(STOPS, 0.0))
    begun = {k: s for k in range(4, 12) if (s := watch.step(k * T, STOP, Seen(ON, 0.0, 0, 0)))}
    assert min(begun) == 4 + 2, "three ticks, the first of which says so"


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
            assert seen.state in UNPOWERED or (seen.state is STOPS and abs(seen.velocity) < 0.02)
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
