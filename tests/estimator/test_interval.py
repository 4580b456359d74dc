"""Impulses of an interval: increments and Tustin's integrals of the values at both ends."""

import numpy as np
import pytest

from errors import ModelError
from estimator.interval import ROW, TERMS, Interval


def at(interval: Interval, **values: float) -> None:
    interval.begin()
    interval.now[:] = 0.0
    for name, value in values.items():
        interval.now[ROW[name]] = value


def test_torques_are_integrated_momenta_are_increments() -> None:
    interval = Interval([{name: 1.0} for name in TERMS], 2)
    at(interval, **{name: 1.0 + row for row, name in enumerate(TERMS)})
    at(interval, **{name: 5.0 + 3 * row for row, name in enumerate(TERMS)})
    impulses = interval.step(np.full(2, 0.02))
    for row, name in enumerate(TERMS):
        first, last = 1.0 + row, 5.0 + 3 * row
        change = name in ("momentum", "rotor", "theta")
        expected = last - first if change else 0.02 * (first + last) / 2
        np.testing.assert_allclose(impulses[row], expected, err_msg=name)


def test_forms_are_sums_and_intervals_may_differ() -> None:
    interval = Interval([{"tau_M": 2.0, "rotor": -1.0}, {}], 1)
    at(interval, tau_M=1.0, rotor=0.5)
    for dt, tau_M, rotor in ((0.01, 3.0, 0.7), (0.03, -1.0, 0.2)):
        before = interval.now[ROW["tau_M"], 0], interval.now[ROW["rotor"], 0]
        at(interval, tau_M=tau_M, rotor=rotor)
        expected = 2.0 * dt * (tau_M + before[0]) / 2 - (rotor - before[1])
        impulses = interval.step(np.array([dt]))
        assert impulses[0, 0] == pytest.approx(expected)
        assert impulses[1, 0] == 0.0


def test_memory_is_of_one_shape() -> None:
    interval = Interval([{}], 2)
    with pytest.raises(ModelError, match="shape"):
        interval.restore(Interval([{}], 3).memory())
