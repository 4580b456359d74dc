"""Proof of a stop: readings that show that a drive stands, and those that it runs on."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.api import DriveCondition
from drivers.stopping.stop_watch import OBEYING, Stage, StopBounds, StopReading, StopWatch
from tests.drivers.stopping.one_watch import (
    BOUNDS,
    LIMP,
    ON,
    RUNS,
    STOPS,
    Course,
    T,
    commanded,
    readings,
)
from tests.examples import scaled

Speed = Callable[[float], float]
STANDS = StopReading(STOPS, 0.0, 0.0, 0.0)
CREEPS_ON = StopReading(ON, 0.1, 0.0, 0.0)


HERTZ, STAGES = (1.5, 2.0, 3.0, 5.0), (Stage.SETPOINT, Stage.DIRECT, Stage.LAST)


def proved(bounds: StopBounds = BOUNDS) -> StopWatch:
    """Watch on a drive whose standstill is proved, in its first two ticks."""
    watch = commanded(bounds=bounds)
    for k in (1, 2):
        watch.step(k * T, STANDS)
    assert watch.proved
    return watch


def path(ticks: range, velocity_at: Speed) -> Iterator[tuple[int, float, float]]:
    """Tick, velocity, and position of a drive that begins at 0."""
    position = 0.0
    for k in ticks:
        velocity = velocity_at(k * T)
        position += velocity * T
        yield k, velocity, position


def hardly_brakes(t: float) -> float:
    """Velocity [rad/s], of a drive that was commanded to stop with 10 rad/s2."""
    return 1.0 - 0.02 * t


@pytest.mark.parametrize("state", [one for one in DriveCondition if not one.powered])
def test_without_power_two_readings_at_rest_prove_a_stop(state: DriveCondition) -> None:
    watch = commanded()
    for k in (1, 2):
        assert watch.unproved
        assert watch.step(k * T, StopReading(state, 0.0, 0.0, 0.0)) is None
    assert watch.proved
    assert not watch.unproved


@pytest.mark.parametrize(
    ("seen", "proved"),
    [
        (StopReading(STOPS, 0.0, 0.0, 0.0), True),
        (StopReading(STOPS, -0.019, 0.0, 0.0), True),
        (StopReading(STOPS, 0.02, 0.0, 0.0), True),  # a bias: its link has rested for long
        (StopReading(STOPS, 0.1, 0.0, 0.0), False),
        (StopReading(STOPS, 0.0), False),  # no second sensor
        (StopReading(STOPS, math.nan, 0.0, 0.0), False),
        (StopReading(LIMP, 1.2, 0.0, 0.0), False),
        (StopReading(LIMP, math.nan, 0.0, 0.0), False),
        (StopReading(ON, 0.0, 0.0, 0.0), False),
        (StopReading(DriveCondition.UNKNOWN, 0.0, 0.0, 0.0), False),
        (StopReading(DriveCondition.FAILING, 0.0, 0.0, 0.0), True),
        (None, False),
    ],
)
def test_two_readings_that_prove_a_stop_and_those_that_do_not(
    seen: StopReading | None, proved: bool
) -> None:
    watch = commanded()
    watch.step(T, seen)
    assert not watch.proved, "once is noise"
    watch.step(2 * T, seen)
    assert watch.proved is proved


def test_two_readings_in_a_row_are_a_proof_and_one_in_operation_between_them_is_not() -> None:
    watch = commanded()
    for k, (seen, proved) in enumerate(
        [(STANDS, False), (CREEPS_ON, False), (STANDS, False), (STANDS, True)], 1
    ):
        watch.step(k * T, seen)
        assert watch.proved is proved, k


def test_a_velocity_with_a_bias_is_no_motion_where_the_position_stays() -> None:
    watch = commanded()
    for k in range(1, 300):
        watch.step(k * T, StopReading(STOPS, 0.03, 0.0, position=0.5 + 0.0001 * min(k, 30)))
        assert watch.proved is (k >= 1 + 20 + 1), "0.2 s, and once more"
        assert not watch.runs_on


@pytest.mark.parametrize("speed", [0.03, 0.5])
def test_a_drive_that_creeps_or_runs_is_not_proved(speed: float) -> None:
    watch = commanded(speed)
    for k in range(1, 200):
        watch.step(k * T, StopReading(STOPS, speed, 0.0, position=speed * k * T))
        assert not watch.proved


@pytest.mark.parametrize(
    ("velocity_at", "current", "runs_on"),
    [
        (lambda t: max(1.0 - 10.0 * t, 0.05), 0.0, False),  # as configured, then in its gap
        (lambda t: max(1.0 - 6.0 * t, 0.05), 0.0, False),  # with a load that pulls
        (lambda t: 1.0, 0.0, True),
        (lambda t: 1.0, 1.5, True),  # by its own power
        (lambda t: 1.0, -0.9, True),  # it could do more, with 2 A
        (lambda t: 1.0, -1.0, False),  # a person is stronger
        (lambda t: -1.0, 1.0, False),
        (lambda t: 1.3 * 0.95 ** (t / T), 0.0, False),  # knocked, it slows down by itself
    ],
)
def test_a_drive_that_reports_a_stop_and_runs_on_loses_its_power(
    velocity_at: Speed, current: float, runs_on: bool
) -> None:
    found = Course(velocity_at, current, ticks=60)
    assert bool(found.runs_on) is runs_on
    assert found.watch.cut is runs_on, "0.59 rad, of 0.24"
    assert found.begun == [], "a stronger stage would end the heartbeat of the other drives, too"


@pytest.mark.parametrize(("deceleration", "runs_on"), [(1.1, False), (0.9, True)])
def test_half_of_the_configured_deceleration_suffices(deceleration: float, runs_on: bool) -> None:
    bounds = replace(BOUNDS, deceleration=2.0, travel=1.0)
    found = Course(lambda t: max(1.0 - deceleration * t, 0.05), bounds=bounds)
    assert bool(found.runs_on) is runs_on


@pytest.mark.parametrize("velocity_at", [hardly_brakes, lambda t: 1.0])
def test_a_drive_runs_on_after_twenty_readings(velocity_at: Speed) -> None:
    """From its fourth: the first is where it left operation, and it may take 20 ms to brake."""
    assert Course(velocity_at).runs_on[0] == 4 + 20 - 1


@pytest.mark.parametrize(
    ("velocity_at", "first"),
    [(hardly_brakes, 4), (lambda t: math.nan, 1)],  # one that was not read is never a calm one
)
def test_readings_from_before_it_was_in_operation_again_do_not_count(
    velocity_at: Speed, first: int
) -> None:
    watch = commanded(1.0)
    for k in range(1, 50):
        seen = RUNS if k == 20 else StopReading(STOPS, velocity_at(k * T), 0.0, k * T)
        watch.step(k * T, seen)
        assert watch.runs_on is (k >= 20 + first + 20 - 1)


@pytest.mark.parametrize(("start", "velocity"), [(0.0, 1.02), (0.7, 1.02), (0.7, -1.02)])
def test_a_drive_that_runs_on_keeps_its_power_within_its_travel(
    start: float, velocity: float
) -> None:
    found = Course(lambda t: velocity, start=start)
    assert found.cut[0] == 24 + 2, "beyond 0.24 rad in the third reading, as docs/faults.md says"
    assert found.begun == []


def test_a_cut_lasts_until_the_drive_may_run() -> None:
    watch = Course(lambda t: 1.0).watch
    assert watch.cut
    for k in range(100, 130):
        assert watch.step(k * T, StopReading(LIMP, 0.0, 0.0, 1.0 + 1e-6 * (k == 101))) is None
    assert watch.proved
    assert watch.cut, "until it may run"
    watch.allow()
    assert not watch.cut


@pytest.mark.parametrize(
    ("velocity_at", "options"),
    [
        *((lambda t, f=f: 0.9 * math.cos(2 * math.pi * f * t), {"ticks": 300}) for f in HERTZ),
        *((lambda t: 1.0, {"current": -1.1, "stage": stage}) for stage in STAGES),
        (lambda t: 0.5, {"condition": LIMP}),
    ],
    ids=[*(f"works at {f} Hz" for f in HERTZ), *(f"pushes in {s.name}" for s in STAGES), "leads"],
)
def test_a_hand_that_moves_a_stopped_drive_leads_to_no_stronger_stage(
    velocity_at: Speed, options: dict[str, Any]
) -> None:
    """Beyond its travel of 0.24 rad under power, and without power as far as the hand goes."""
    found = Course(velocity_at, **options)
    assert (found.begun, found.cut) == ([], [])
    assert "ticks" not in options or not found.watch.proved
    assert "condition" not in options or found.runs_on == []


def test_a_link_that_swings_in_its_gap_runs_on_after_a_second() -> None:
    """After 0.18 s, in which half of its ramp would have stopped the 0.9 rad/s it was seen with."""
    found = Course(lambda t: max(1.0 - 10.0 * t, 0.06), ticks=200)
    braked = 1 + 2 + 18  # ticks: seen, its lag, its ramp
    assert found.runs_on[0] == braked + 100 + 20 - 1


def test_a_proof_ends_when_the_drive_runs_on_by_itself() -> None:
    watch = proved()
    for k in range(200):
        watch.step(2.0 + k * T, StopReading(STOPS, 0.3, 0.1, 0.3 * k * T))
    assert watch.runs_on
    assert watch.proved is False


@pytest.mark.parametrize(
    ("velocity_at", "seen_at", "about"),
    [
        (lambda t: 0.6, lambda t: 0.0, "its velocity has died"),
        (lambda t: 0.6 * math.sin(6.0 * math.pi * t), None, "it hunts"),
        (lambda t: 0.05, lambda t: 0.0, "slowly, by its position alone"),
    ],
)
def test_no_proof_outlives_a_motion_that_any_sensor_shows(
    velocity_at: Speed, seen_at: Speed | None, about: str
) -> None:
    watch, held = proved(), 0
    for k, velocity, position in path(range(3, 303), velocity_at):
        shown = seen_at(k * T) if seen_at else velocity
        watch.step(k * T, StopReading(STOPS, shown, 0.0, position))
        held += watch.proved
    assert held <= 45, about


def test_a_drive_that_hunts_by_its_own_power_loses_it() -> None:
    """A hand that works at a joint as fast does not: see above."""
    watch = commanded(0.6)
    for k, velocity, position in path(range(1, 100), lambda t: 0.6 * math.sin(6.0 * math.pi * t)):
        drives = 0.3 if k % 5 else -0.3  # it brakes at times
        watch.step(k * T, StopReading(STOPS, velocity, math.copysign(drives, velocity), position))
    assert watch.cut


def test_a_drive_that_brakes_while_it_swings_is_not_proved() -> None:
    """8 Hz within its gap, at its highest current in each turn, which is half of the readings."""
    watch = proved(replace(BOUNDS, play=0.05))
    for k, velocity, position in path(range(3, 200), lambda t: 0.6 * math.sin(16.0 * math.pi * t)):
        current = math.copysign(2.0, math.cos(16.0 * math.pi * k * T))
        watch.step(k * T, StopReading(STOPS, velocity, current, position))
    assert not watch.proved


@pytest.mark.parametrize(("speed", "slips_s", "every_s"), [(0.6, 0.12, 0.5), (1.0, 0.18, 0.6)])
def test_a_drive_that_slips_and_sticks_by_its_own_power_loses_it(
    speed: float, slips_s: float, every_s: float
) -> None:
    watch, gone = commanded(), 0.0
    slips = path(range(1, 2000), lambda t: speed if t % every_s < slips_s else 0.0)
    for k, velocity, position in slips:
        watch.step(k * T, StopReading(STOPS, velocity, 0.4 if velocity else 0.1, position))
        gone = position if not watch.cut else gone
    assert watch.cut
    assert gone < 0.24 + 0.1 * speed


def test_a_ripple_does_not_hide_a_drive_that_runs_on() -> None:
    found = Course(lambda t: 0.6 * (1.0 + 0.1 * math.sin(16.0 * math.pi * t)))
    assert found.runs_on
    assert found.cut[0] * T * 0.6 < 0.24 + 0.05


@pytest.mark.parametrize(("alive", "proved"), [(False, False), (True, True)])
def test_a_sudden_stop_is_one_only_if_a_sensor_changes_after_it(alive: bool, proved: bool) -> None:
    """From 0.4 rad/s to nothing within 10 ms, four times its ramp; its current is noise."""
    watch = commanded(0.4)
    for k in range(1, 100):
        runs = k < 5
        position = 0.004 * min(k, 4) + (1e-6 if alive and k > 6 else 0.0)
        watch.step(k * T, StopReading(STOPS, 0.4 if runs else 0.0, 1e-3 * (k % 7), position))
    assert watch.proved is proved


def test_a_proof_is_void_when_the_drive_runs_again() -> None:
    watch = proved()
    for k in range(3, 30):
        assert watch.step(k * T, None) is None, "its silence is no news"
    assert watch.proved
    assert watch.step(0.3, RUNS) is None
    assert watch.unproved
    assert watch.stage is Stage.SETPOINT


@pytest.mark.parametrize(
    ("last", "proved"), [(STANDS, False), (StopReading(LIMP, 0.0, 0.0, 0.0), True)]
)
def test_a_proof_under_power_is_as_old_as_its_last_reading(last: StopReading, proved: bool) -> None:
    watch = commanded()
    for k in (1, 2, 3):
        watch.step(k * T, STANDS if k < 3 else last)
    assert watch.proved
    for k in range(4, 36):
        watch.step(k * T, None)
    assert watch.proved is proved


def test_a_motion_under_power_is_seen_before_the_proof_is_void() -> None:
    watch = proved()
    watch.step(0.03, StopReading(STOPS, 0.5, 0.1, 0.005))
    assert watch.moves
    watch.step(0.04, STANDS)
    assert watch.proved
    assert not watch.moves


def test_a_proof_forgets_earlier_readings_in_operation() -> None:
    watch = commanded()
    for k in (1, 2):
        watch.step(k * T, CREEPS_ON)
    for k in (3, 4):
        watch.step(k * T, STANDS)
    assert watch.proved
    begun = {k: s for k in range(5, 12) if (s := watch.step(k * T, StopReading(ON, 0.0, 0, 0)))}
    assert min(begun) == 5 + 2, "three ticks, the first of which says so"


def test_a_watch_ends_when_the_drive_may_run() -> None:
    watch = commanded(stage=Stage.LAST)
    watch.allow()
    assert (watch.stage, watch.unproved, watch.proved) == (Stage.NONE, False, False)


@settings(max_examples=scaled(200))
@given(ticks=st.lists(st.tuples(readings(DriveCondition), st.floats(0.001, 3.0)), max_size=40))
def test_only_a_reading_proves_a_stop_and_no_stage_gets_weaker(
    ticks: list[tuple[StopReading | None, float]],
) -> None:
    watch, now = commanded(), 0.0
    for seen, dt in ticks:
        before, proved, now = watch.stage, watch.proved, now + dt
        watch.step(now, seen)
        if watch.proved and not proved:
            assert seen is not None
            assert seen.condition in OBEYING
        if proved and not watch.proved:
            assert seen is not None
        elif not (proved or watch.proved):
            assert watch.stage >= before


def test_a_drive_that_pressed_on_a_wall_is_proved_once_its_link_was_moved_by_hand() -> None:
    """It was commanded to move and could not: a coarse encoder that stayed may be a dead one."""
    watch = StopWatch(BOUNDS)
    for k in range(50):
        watch.witness.command(k * T, 0.3)
        watch.witness.take(k * T, 0.0, 1.0 + 1e-3 * (k % 7), 0.2)
    watch.begin(50 * T, Stage.SETPOINT, 0.0)
    for k in range(51, 400):
        link = 0.2 if k < 300 else 0.203
        watch.step(k * T, StopReading(STOPS, 0.0, 0.5 + 1e-3 * (k % 7), link))
        assert watch.proved is (k >= 300 + 1), k
