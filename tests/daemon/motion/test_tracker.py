"""Tracker of a moving target: within its limits, whatever the target does, and without a lag."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.motion.tracker import JERK_S, Tracker

DT = 0.01
FULLEST = np.array([4.0, 2.0])
MOST = np.array([1.0, 0.5])


def tracker() -> Tracker:
    return Tracker(np.zeros(2), FULLEST)


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=1, max_size=60))
def test_no_target_makes_it_exceed_a_limit(targets: list[tuple[float, float]]) -> None:
    tracked, before, push = tracker(), np.zeros(2), np.zeros(2)
    for q, speed in targets:
        reference = tracked.step(np.full(2, q), np.full(2, speed), MOST, DT)
        acceleration = (reference.velocity - before) / DT
        assert (np.abs(acceleration) <= FULLEST * (1 + 1e-9)).all()
        assert (np.abs(acceleration - push) <= FULLEST * (DT / JERK_S) * (1 + 1e-9) + 1e-12).all()
        # The jerk limit lets it run beyond by what it takes to end the acceleration.
        assert (np.abs(reference.velocity) <= MOST + 0.5 * FULLEST * (JERK_S + DT)).all()
        before, push = reference.velocity, acceleration


def test_a_moving_target_is_followed_without_a_lag() -> None:
    tracked = tracker()
    for tick in range(400):
        s = tick * DT
        target = np.array([0.3, 0.1]) * np.sin(2.0 * s)
        speed = np.array([0.6, 0.2]) * np.cos(2.0 * s)
        tracked.step(target, speed, MOST, DT)
        if tick > 100:
            assert np.abs(tracked.q - target).max() < 0.01


def test_a_step_is_approached_without_running_beyond() -> None:
    tracked, goal = tracker(), np.array([0.5, -0.3])
    ways = [tracked.step(goal, np.zeros(2), MOST, DT).q for _ in range(400)]
    np.testing.assert_allclose(ways[-1], goal, atol=1e-3)
    assert (np.abs(np.array(ways)) <= np.abs(goal) + 0.01).all()


def test_it_brakes_with_all_it_has() -> None:
    tracked = tracker()
    for _ in range(100):
        tracked.step(np.full(2, 9.0), np.zeros(2), MOST, DT)
    moving = np.abs(tracked.velocity)
    assert moving == pytest.approx(MOST, rel=0.2)
    for _ in range(int(np.ceil((moving / FULLEST).max() / DT))):
        tracked.brake(tracked.q - 0.01, FULLEST, DT)
    assert not tracked.velocity.any()
    stands = tracked.q
    assert tracked.brake(stands - 0.01, FULLEST, DT).q is not stands
    np.testing.assert_array_equal(tracked.q, stands)
