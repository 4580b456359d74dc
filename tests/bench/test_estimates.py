"""The Kalman rival sees what the residual that it is made from has seen."""

import numpy as np

from bench.estimates import kalman
from bench.rivals import KalmanObserver, fair_index

K, T = 25.0, 0.01


def test_kalman_from_a_residual_is_kalman_from_its_impulses() -> None:
    impulses = 0.01 * np.random.default_rng(2).normal(size=(200, 3))
    residual, r = np.empty_like(impulses), np.zeros(3)
    for k, e in enumerate(impulses):
        r = ((2.0 - T * K) * r + 2.0 * K * e) / (2.0 + T * K)  # (13)
        residual[k] = r
    observer = KalmanObserver(3, fair_index(T * K), T)
    expected = [observer.step(e, T) for e in impulses]
    np.testing.assert_allclose(kalman(residual, K, T), expected, atol=1e-12)
