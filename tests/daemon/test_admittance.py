"""Eq. (15): velocity from the thresholded residual, and what bounds it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.admittance import AdmittanceLaw

DT = 0.01
LAW = AdmittanceLaw(
    gain=np.array([0.08, 0.5, 0.0]),
    virtual_mass_s=0.05,
    velocity=np.full(3, 0.5),
    max_duration_s=120.0,
    max_excursion=1.5,
)


def settled(push: list[float], law: AdmittanceLaw = LAW) -> np.ndarray:
    velocity = np.zeros(3)
    for _ in range(300):
        velocity = law.velocity_after(velocity, np.array(push), DT)
    return velocity


@pytest.mark.parametrize(
    ("push", "velocity"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([2.0, 0.4, 5.0], [0.16, 0.2, 0.0]),
        ([-2.0, -0.4, -5.0], [-0.16, -0.2, 0.0]),
        ([100.0, -100.0, 0.0], [0.5, -0.5, 0.0]),
    ],
)
def test_pushed_long_it_moves_at_gain_times_push(push: list[float], velocity: list[float]) -> None:
    np.testing.assert_allclose(settled(push), velocity, atol=1e-12)


def test_the_virtual_mass_is_its_time_constant() -> None:
    dt, velocity = 1e-4, np.zeros(3)
    for _ in range(500):  # one time constant
        velocity = LAW.velocity_after(velocity, np.array([1.0, 0.0, 0.0]), dt)
    assert velocity[0] == pytest.approx(0.08 * (1 - np.exp(-1)), rel=2e-3)


def test_without_virtual_mass_it_follows_at_once() -> None:
    law = replace(LAW, virtual_mass_s=0.0)
    np.testing.assert_allclose(
        law.velocity_after(np.full(3, 0.3), np.array([1.0, 0.0, 1.0]), DT), [0.08, 0.0, 0.0]
    )


@given(
    before=st.floats(-0.5, 0.5),
    push=st.floats(-1e6, 1e6),
    dt=st.floats(1e-4, 10.0),
)
def test_for_every_interval_it_ends_between_before_and_the_target(
    before: float, push: float, dt: float
) -> None:
    after = LAW.velocity_after(np.full(3, before), np.full(3, push), dt)
    target = np.clip(LAW.gain * push, -LAW.velocity, LAW.velocity)
    assert (np.abs(after) <= 0.5 + 1e-12).all()
    assert (after >= np.minimum(before, target) - 1e-12).all()
    assert (after <= np.maximum(before, target) + 1e-12).all()


@pytest.mark.parametrize(
    ("elapsed", "excursion", "words"),
    [
        (120.0, [1.5, -1.5, 0.0], ""),
        (120.001, [0.0, 0.0, 0.0], "more than 120 s"),
        (1.0, [0.0, -1.501, 0.0], "further than 1.5 rad"),
        (1.0, [0.0, 0.0, 1.501], "further than 1.5 rad"),
    ],
)
def test_bounds(elapsed: float, excursion: list[float], words: str) -> None:
    reached = LAW.bound_reached(elapsed, np.array(excursion))
    assert words in reached
    assert bool(reached) is bool(words)
