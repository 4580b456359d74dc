"""Excitations: within their bounds, from rest to rest, and better conditioned than the first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import ModelError
from identification.excitation import (
    Bounds,
    condition,
    fourier_within,
    point_to_point,
    smooth_path_times,
    trajectory,
)
from tests.examples import scaled


@pytest.mark.parametrize("lowest", [1, 4])
@pytest.mark.parametrize("seed", range(3))
def test_keeps_within_its_bounds(arm, seed, lowest):
    bounds, rng = arm.bounds.shrunk(0.7), np.random.default_rng(seed)
    turn = {"period_s": 8.0 * lowest, "lowest": lowest}
    motion = fourier_within(bounds, arm.model, rng, restarts=3, **turn)
    q = trajectory(motion, 0.5 * (bounds.lower + bounds.upper), bounds, 16.0, 0.01)
    v = np.diff(q, axis=0) / 0.01
    a = np.diff(v, axis=0) / 0.01
    assert (q > bounds.lower - 0.01).all()
    assert (q < bounds.upper + 0.01).all()
    assert (np.abs(v) < 1.02 * bounds.velocity).all()
    assert (np.abs(a) < 1.2 * bounds.acceleration).all()
    assert np.abs(v[[0, -1]]).max() < 0.01


def test_it_repeats_after_its_period_and_not_before(arm):
    bounds, rng = arm.bounds.shrunk(0.7), np.random.default_rng(0)
    motion = fourier_within(bounds, arm.model, rng, period_s=32.0, lowest=4, restarts=3)
    s = np.linspace(0.0, 8.0, 50)
    q, _, _ = motion.at(s)
    assert motion.at(s + 32.0)[0] == pytest.approx(q, abs=1e-9)
    for turn in (8.0, 16.0, 24.0):
        assert (np.abs(motion.at(s + turn)[0] - q).max(axis=0) > 0.1 * np.ptp(q, axis=0)).all()
    # The same band as of one of 8 s.
    spectrum = np.abs(np.fft.rfft(motion.at(np.arange(0.0, 32.0, 0.1))[0], axis=0)).max(axis=1)
    assert set(np.flatnonzero(spectrum[1:] > 1e-6) + 1) == set(range(4, 25))


def test_restarts_are_worth_it(arm):
    bounds = arm.bounds.shrunk(0.7)

    def worst(seed: int, restarts: int) -> float:
        rng = np.random.default_rng(seed)
        motion = fourier_within(bounds, arm.model, rng, restarts=restarts)
        return float(condition(motion, arm.model, 0.02).max())

    assert worst(0, 100) < 0.7 * np.median([worst(seed, 1) for seed in range(15)])


def test_a_joint_without_room_is_named(arm):
    b = arm.bounds
    upper = np.where(np.arange(7) == 3, b.lower, b.upper)
    shut = Bounds(b.lower, upper, b.velocity, b.acceleration)
    with pytest.raises(ModelError, match="LElbowYaw has no room"):
        fourier_within(shut, arm.model, np.random.default_rng(0))


@given(length=st.floats(0.5, 60.0), ramp=st.floats(0.1, 10.0))
@settings(max_examples=scaled(50))
def test_soft_run_never_turns_back(length, ramp):
    s = smooth_path_times(length, ramp, 0.01)
    rate = np.diff(s) / 0.01
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(length, abs=1e-6)
    assert (rate >= -1e-9).all()
    assert rate.max() < 1.0 + 1e-6
    assert max(rate[0], rate[-1]) < 0.05 / min(ramp, length) + 1e-9


@given(way=st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
@settings(max_examples=scaled(50))
def test_point_to_point_obeys(way):
    bounds = Bounds(-3 * np.ones(3), 3 * np.ones(3), np.array([0.5, 1.0, 2.0]), np.full(3, 4.0))
    q = point_to_point(np.zeros(3), np.array(way), bounds, 0.01)
    v = np.diff(q, axis=0) / 0.01
    assert q[0] == pytest.approx(np.zeros(3))
    assert q[-1] == pytest.approx(np.array(way))
    assert (np.abs(v) <= bounds.velocity + 1e-6).all()
