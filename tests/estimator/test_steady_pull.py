"""Steady pull: what a contact looks like that could be a load, with the arm at rest."""

from collections.abc import Callable

import numpy as np
import pytest

from estimator.model import Model
from estimator.steady_pull import SteadyPull

T = 0.01
LEVEL = np.array([0.4, 0.25, 0.2, 0.15, 0.08, 0.08, 0.08])
POSE = np.array([0.3, 0.3, 0.0, -0.8, -1.2, 0.0, 0.0])
DOWN = np.array([0.0, 0.0, -9.81])
STILL = np.zeros(7)

Force = Callable[[float], np.ndarray]


def shown(model: Model, force: np.ndarray) -> np.ndarray:
    """Torques of a force at the tool [N]."""
    torque: np.ndarray = model.tool_jacobian(POSE).T @ force
    return torque


def watch(pull: SteadyPull, model: Model, force: Force, seconds: float) -> float | None:
    """Time at which it pulls like a load [s], with noise of a fifth of the level; None if never."""
    rng = np.random.default_rng(5)
    for k in range(round(seconds / T)):
        residual = shown(model, force(k * T)) + 0.2 * LEVEL * rng.normal(size=7)
        touched = bool((np.abs(residual) > LEVEL).any())
        pull.step(POSE, STILL, residual, LEVEL, touched=touched)
        if pull.mass:
            return (k + 1) * T
    return None


@pytest.mark.parametrize("mass", [0.25, 0.5, 2.0])
def test_a_load_on_an_arm_that_stands_is_said_within_two_seconds(romeo: Model, mass: float) -> None:
    pull = SteadyPull(romeo, T)
    assert watch(pull, romeo, lambda t: mass * DOWN, 5.0) == pytest.approx(2.0)
    assert pull.mass == pytest.approx(mass, rel=0.1)


FORCES: dict[str, Force] = {
    "nothing": lambda t: 0.0 * DOWN,
    "too little to be felt": lambda t: 0.05 * DOWN,
    "upwards": lambda t: -0.5 * DOWN,
    "sideways": lambda t: np.array([6.0, 0.0, 0.0]),
    "slanting": lambda t: np.array([4.0, 4.0, -4.0]),
    "down, now more, now less": lambda t: DOWN * (0.6 + 0.3 * np.sin(3.0 * t)),
    "down, growing": lambda t: DOWN * 0.3 * t,
    "down, for a second": lambda t: DOWN * (t < 1.0),
}


@pytest.mark.parametrize("name", FORCES)
def test_what_pulls_otherwise_is_not_said(romeo: Model, name: str) -> None:
    assert watch(SteadyPull(romeo, T), romeo, FORCES[name], 4.0) is None


def test_it_lasts_where_it_is_just_no_longer_felt_and_is_forgotten_with_the_contact(
    romeo: Model,
) -> None:
    pull = SteadyPull(romeo, T)
    assert watch(pull, romeo, lambda t: 0.5 * DOWN, 3.0) is not None
    seen = shown(romeo, 0.5 * DOWN)
    for _ in range(200):
        pull.step(POSE, STILL, seen, 20.0 * LEVEL, touched=False)
    assert pull.lasts
    for _ in range(100):
        pull.step(POSE, STILL, seen, 20.0 * LEVEL, touched=False)
    assert not pull.lasts
    assert pull.mass == 0.0


def test_another_load_takes_two_seconds_again(romeo: Model) -> None:
    pull = SteadyPull(romeo, T)
    assert watch(pull, romeo, lambda t: 0.5 * DOWN, 3.0) is not None
    pull.forget()
    assert pull.mass == 0.0
    assert watch(pull, romeo, lambda t: 1.0 * DOWN, 3.0) == pytest.approx(2.0)
    assert pull.mass == pytest.approx(1.0, rel=0.1)
    seen = shown(romeo, 0.5 * DOWN)
    for _ in range(100):  # taken half of it
        pull.step(POSE, STILL, seen, LEVEL, touched=True)
    assert pull.mass == 0.0
    for _ in range(100):
        pull.step(POSE, STILL, seen, LEVEL, touched=True)
    assert pull.mass == pytest.approx(0.5, rel=0.1)
