"""Kalman rival against its closed form: the comparison is fair if it is tuned as stated."""

import numpy as np
import pytest

from bench.study.rivals import KalmanObserver, fair_index, kalman

PERIOD = 0.01


def steady_gains(index):
    """Share of an innovation of p that goes into p, and times 1 / T into d, in closed form."""
    r = (4.0 + index - np.sqrt(index * (8.0 + index))) / 4.0
    return 1.0 - r * r, 2.0 * (1.0 - r) ** 2


def settled(index, period=PERIOD, n=1):
    observer = KalmanObserver(n, index, period)
    for _ in range(400):
        observer.step(np.zeros(n), period)
    return observer


def response(observer, torques, period=PERIOD):
    """External torque that the observer sees when it is really `torques`, tick by tick."""
    return np.array([observer.step(np.array([u * period]), period)[0] for u in torques])


@pytest.mark.parametrize("TK", [0.05, 0.25, 1.0])
def test_the_gain_settles_at_the_closed_form(TK):
    a, b = steady_gains(fair_index(TK))
    expected = [0.0, 0.0]
    for u in np.ones(60):
        expected.append((2 - a - b) * expected[-1] - (1 - a) * expected[-2] + b * u)
    seen = response(settled(fair_index(TK)), np.ones(60))
    assert seen == pytest.approx(expected[2:], rel=1e-9)
    assert seen[-1] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("TK", [0.05, 0.25, 1.0])
def test_white_torque_comes_through_as_through_the_residual(TK):
    impulse = np.zeros(600)
    impulse[0] = 1.0
    r, residual = 0.0, []
    for u in impulse:  # (13), driven by the mean torque of each interval
        r = ((2 - TK) * r + 2 * TK * u) / (2 + TK)
        residual.append(r)
    observed = response(settled(fair_index(TK)), impulse)
    assert np.sum(np.square(residual)) == pytest.approx(TK / 2)
    assert np.sum(np.square(observed)) == pytest.approx(TK / 2)


def test_it_is_a_butterworth_filter_when_samples_are_dense():
    gain, period = 25.0, 0.0005
    t = period * np.arange(1, 400)
    expected = 1.0 - np.exp(-gain * t) * (np.cos(gain * t) + np.sin(gain * t))
    seen = response(settled(fair_index(gain * period), period), np.ones(len(t)), period)
    assert seen == pytest.approx(expected, abs=0.01)


def test_joints_do_not_know_each_other():
    observer = settled(fair_index(0.25), n=2)
    assert observer.step(np.array([0.0, 0.01]), PERIOD)[0] == 0.0


def test_kalman_from_a_residual_is_kalman_from_its_impulses():
    impulses = 0.01 * np.random.default_rng(2).normal(size=(200, 3))
    K, T = 25.0, PERIOD
    residual, r = np.empty_like(impulses), np.zeros(3)
    for k, e in enumerate(impulses):
        r = ((2.0 - T * K) * r + 2.0 * K * e) / (2.0 + T * K)  # (13)
        residual[k] = r
    observer = KalmanObserver(3, fair_index(T * K), T)
    expected = [observer.step(e, T) for e in impulses]
    np.testing.assert_allclose(kalman(residual, K, T), expected, atol=1e-12)
