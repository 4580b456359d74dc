"""Straight line through joint space, within given speeds and accelerations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.motion.line import Line

position = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)
bound = st.lists(st.floats(0.05, 5.0), min_size=3, max_size=3).map(np.array)


@given(start=position, end=position, velocity=bound, acceleration=bound)
def test_it_arrives_within_its_bounds_and_nowhere_else(
    start: np.ndarray, end: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> None:
    line = Line.between(start, end, velocity, acceleration)
    dt = max(line.duration_s / 200.0, 1e-9)
    points = [line.at(k * dt) for k in range(202)]
    np.testing.assert_allclose(points[0].q, start, atol=1e-9)
    np.testing.assert_allclose(points[-1].q, end, atol=1e-9)
    assert not points[-1].velocity.any()
    q = np.array([point.q for point in points])
    v = np.array([point.velocity for point in points])
    assert (q >= np.minimum(start, end) - 1e-9).all()
    assert (q <= np.maximum(start, end) + 1e-9).all()
    assert (np.abs(v) <= velocity * (1 + 1e-9)).all()
    assert (np.abs(np.diff(v, axis=0)) <= acceleration * dt * (1 + 1e-6) + 1e-12).all()
    # The velocity is the position's: trapezoids, but for the corners.
    mean = 0.5 * (v[1:] + v[:-1])
    np.testing.assert_allclose(
        np.diff(q, axis=0), mean * dt, atol=float(acceleration.max()) * dt**2 + 1e-12
    )


def test_a_long_line_is_as_fast_as_it_may_be() -> None:
    one = np.ones(1)
    line = Line.between(0 * one, 2 * one, 0.5 * one, 1 * one)
    assert line.duration_s == pytest.approx(2 / 0.5 + 0.5 / 1)
    assert line.at(2.0).velocity == pytest.approx(0.5)
    short = Line.between(0 * one, 0.04 * one, 0.5 * one, 1 * one)
    assert short.duration_s == pytest.approx(2 * (0.04 / 1) ** 0.5)


def test_no_way_takes_no_time() -> None:
    here = np.array([0.1, -0.2])
    line = Line.between(here, here, np.ones(2), np.ones(2))
    assert line.duration_s == 0.0
    np.testing.assert_array_equal(line.at(0.0).q, here)
