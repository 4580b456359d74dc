"""Impulses of an interval: increments and Tustin's integrals of the values at both ends."""

import numpy as np
import pytest

from estimator.interval import ROW, TERMS, Interval

DT = 0.02


def test_torques_are_integrated_momenta_are_increments() -> None:
    interval = Interval(2)
    first, last = (
        np.array([a + b * row for row in range(len(TERMS))]) for a, b in ((1, 1), (5, 3))
    )
    np.asarray(interval.now)[:] = first
    interval.end(1)
    np.asarray(interval.now)[:] = last
    interval.integrate(1, DT)
    for row, name in enumerate(TERMS):
        change = name in ("momentum", "rotor", "theta")
        expected = last[row] - first[row] if change else DT * (first[row] + last[row]) / 2
        assert interval.impulse[row] == pytest.approx(expected), name


def test_joints_have_intervals_of_their_own() -> None:
    interval = Interval(2)
    now = np.asarray(interval.now)
    for value in (1.0, 2.0, 4.0):
        now[:] = value
        interval.integrate(0, DT)
        interval.end(0)
    assert interval.impulse[ROW["momentum"]] == 2.0
    # The other one has no sample in the meantime: its interval still begins at rest.
    interval.integrate(1, 3 * DT)
    assert interval.impulse[ROW["momentum"]] == 4.0
    assert interval.impulse[ROW["tau_M"]] == pytest.approx(3 * DT * 4.0 / 2)
    interval.restart(0)
    assert not np.asarray(interval.begin).any()
