"""Stages of a stop: when the next begins, and how far a joint may have gone by then."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.api import DriveCondition
from drivers.stopping.stop_watch import Stage, StopReading, StopWatch
from drivers.stopping.travel import stage_ticks
from tests.drivers.stopping.one_watch import ON, RUNS, STOPS, T, commanded, readings
from tests.examples import scaled


def stages(watch: StopWatch, seen: StopReading | None, ticks: int) -> dict[int, Stage]:
    """Tick -> stage that began in it; every tick shows the same. The first tick commands it."""
    found = {k: watch.step(k * T, seen) for k in range(ticks + 1)}
    return {k: stage for k, stage in found.items() if stage is not None}


@pytest.mark.parametrize("seen", [None, RUNS, StopReading(DriveCondition.UNKNOWN, 0.0)])
def test_without_a_proof_it_is_commanded_more_strongly_each_time(seen: StopReading | None) -> None:
    # Slow enough for its travel to last: three ticks, then six, then nine.
    slow = seen and StopReading(seen.condition, 0.1, 0.0, 0.0)
    assert stages(commanded(0.1), slow, 30) == {3: Stage.DIRECT, 9: Stage.LAST, 18: Stage.SILENCE}


@pytest.mark.parametrize("start", [None, 0.0, 0.7, -0.7])
def test_at_full_speed_silence_comes_while_the_travel_still_suffices(start: float | None) -> None:
    """0.24 rad, less 0.1 for the drives' master timeout and 0.05 of braking, at 1 rad/s."""
    watch = commanded(1.0, position=start or 0.0)
    found = {}
    for k in range(30):
        here = None if start is None else StopReading(ON, 1.0, 0.0, position=start + k * T)
        if stage := watch.step(k * T, here):
            found[k] = stage
    assert found == {3: Stage.DIRECT, 6: Stage.LAST, 9: Stage.SILENCE}


def test_the_first_stage_has_its_ticks_however_fast_it_is() -> None:
    begun = stages(commanded(3.0), None, 10)
    assert begun == {3: Stage.DIRECT, 4: Stage.LAST, 5: Stage.SILENCE}


@pytest.mark.parametrize(
    ("was", "seen", "begun"),
    [
        (1.0, StopReading(ON, 0.1), {6: Stage.LAST, 15: Stage.SILENCE}),  # it has slowed down since
        (0.1, StopReading(ON, 1.0), {6: Stage.LAST, 9: Stage.SILENCE}),
        (1.0, StopReading(ON, math.nan), {6: Stage.LAST, 9: Stage.SILENCE}),  # as fast as it was
        (math.nan, None, {6: Stage.LAST, 15: Stage.SILENCE}),  # never read: nothing to go by
    ],
)
def test_how_fast_it_is_counts_as_last_seen(
    was: float, seen: StopReading | None, begun: dict[int, Stage]
) -> None:
    assert stages(commanded(was, Stage.DIRECT), seen, 30) == begun


@pytest.mark.parametrize(
    ("speed", "begun"),
    [
        (0.5, {17: Stage.LAST, 26: Stage.SILENCE}),  # it stands by then
        (1.2, {14: Stage.LAST, 17: Stage.SILENCE}),  # 0.7 rad/s, and 0.13 rad gone
    ],
)
def test_unheard_it_brakes_with_half_its_ramp_for_as_long_as_it_was_seen_to(
    speed: float, begun: dict[int, Stage]
) -> None:
    watch = commanded(speed, Stage.DIRECT)
    watch.step(T, StopReading(STOPS, speed))
    found = {k: watch.step(k * T, None) for k in range(2, 30)}
    assert {k: stage for k, stage in found.items() if stage} == begun


def test_samples_lost_in_a_burst_are_no_doubt_of_a_drive_that_was_seen_to_brake() -> None:
    for burst in (5, 8, 10):
        watch = commanded(1.0)
        watch.step(T, RUNS)
        for k in range(2, 5):
            watch.step(k * T, StopReading(STOPS, 1.0 - 10.0 * (k - 1) * T, 0.0, k * T))
        for k in range(5, 5 + burst):
            assert watch.step(k * T, None) is None


def test_a_reading_holds_for_ten_ticks() -> None:
    watch = commanded(0.05)
    assert watch.step(T, StopReading(STOPS, 0.05)) is None
    silent = {k: stage for k in range(2, 20) if (stage := watch.step(k * T, None))}
    assert min(silent) == 1 + 10 + 3


@pytest.mark.parametrize(
    ("pattern", "begins"), [("w", 3), ("wwo", 5), ("wo", None), ("wooo", None), ("o", None)]
)
def test_one_good_tick_takes_one_bad_tick_away_and_no_more(
    pattern: str, begins: int | None
) -> None:
    wrong, right = StopReading(ON, 0.0, 0.0, 0.0), StopReading(STOPS, 0.05, 0.0, 0.0)
    watch = commanded(0.05)
    begun = [
        k
        for k in range(1, 60)
        if watch.step(k * T, wrong if (pattern * 60)[k - 1] == "w" else right)
    ]
    assert (begun[0] if begun else None) == begins


def test_a_late_tick_is_no_more_than_two_bad_ones() -> None:
    watch = commanded()
    assert watch.step(0.5, None) is None
    assert watch.step(0.51, None) is Stage.DIRECT


@settings(max_examples=scaled(100))
@given(speed=st.floats(0.0, 1.0), seen=readings([ON]))
def test_a_drive_that_never_obeys_ends_in_silence_in_time(
    speed: float, seen: StopReading | None
) -> None:
    watch = commanded(speed)
    begun = stages(watch, seen, 18)
    assert watch.stage is Stage.SILENCE, begun


@pytest.mark.parametrize(
    ("master_timeout_s", "period_s", "ticks"),
    [(0.1, 0.01, 3), (0.12, 0.01, 4), (0.1, 0.001, 33), (0.03, 0.01, 3), (0.09, 0.01, 3)],
)
def test_the_stages_take_the_drives_patience_and_leave_them_time_to_answer(
    master_timeout_s: float, period_s: float, ticks: int
) -> None:
    assert stage_ticks(master_timeout_s, period_s) == ticks
