"""Causes that may move an arm that yields: agreement, stated level, and a witnessed hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.motion.hand_witness import (
    ALONE_RAD,
    ALONE_S,
    HandWitness,
    IndependentResidual,
    agreed,
    beyond_stated,
)

T = 0.01
CONTACT, COULOMB, VISCOUS = 0.4, 0.44, 0.22
LEARNED, STATED = 0.1, 0.4


def witness() -> HandWitness:
    made = HandWitness(np.array([COULOMB]), np.array([VISCOUS]))
    made.begin()
    return made


def step(on: HandWitness, size: float, velocity: float, stated: float = STATED) -> float:
    felt = IndependentResidual(
        np.array([size]), np.array([LEARNED]), np.array([stated]), np.array([CONTACT])
    )
    return float(on.step(felt, np.array([velocity]), T)[0])


@pytest.mark.parametrize(
    ("corrected", "uncorrected", "expected"),
    [
        (0.5, 0.3, 0.3),
        (0.3, 0.5, 0.3),
        (-0.5, -0.3, -0.3),
        (0.5, -0.3, 0.0),
        (-0.5, 0.3, 0.0),
        (0.5, 0.0, 0.0),
        (0.5, 0.5, 0.5),
    ],
)
def test_only_what_both_residuals_show_is_agreed(
    corrected: float, uncorrected: float, expected: float
) -> None:
    assert agreed(np.array([corrected]), np.array([uncorrected])) == pytest.approx(expected)


torques = st.floats(-10.0, 10.0)


@given(torques, torques)
def test_learning_never_adds_to_what_moves_the_arm(corrected: float, uncorrected: float) -> None:
    (both,) = agreed(np.array([corrected]), np.array([uncorrected]))
    assert abs(both) <= min(abs(corrected), abs(uncorrected))
    assert both * uncorrected >= 0.0


@pytest.mark.parametrize(
    ("size", "expected"),
    [(0.39, 0.0), (0.5, 0.1), (-0.5, -0.1), (0.84, 0.44), (0.85, 0.75), (-0.85, -0.75)],
)
def test_the_learned_level_counts_once_a_hand_is_witnessed(size: float, expected: float) -> None:
    """Beyond the configured level and all friction, 0.84 Nm, the motor is driven."""
    assert step(witness(), size, 0.0) == pytest.approx(expected)


def test_the_learned_level_counts_no_longer_once_the_hand_is_gone() -> None:
    on = witness()
    step(on, 1.2, 0.1)
    light = [step(on, 0.3, 0.0) for _ in range(round(2 * ALONE_S / T))]
    assert light[0] == pytest.approx(0.2)
    assert light[-1] == 0.0
    assert (on.hand, on.leads) == (True, False)


def test_a_joint_that_goes_on_by_what_friction_may_pretend_stands() -> None:
    on = witness()
    pushes = [step(on, 0.6, 0.3) for _ in range(50)]
    assert pushes[0] == pytest.approx(0.2)
    assert sum(push != 0.0 for push in pushes) * T <= ALONE_S + T
    assert on.stands


@pytest.mark.parametrize("first", [0.0, np.nan])
def test_creeping_has_a_bound_in_distance(first: float) -> None:
    on, speed, gone = witness(), 0.019, 0.0
    step(on, 0.6, first)  # a velocity that is no number is not the end of the bound
    while step(on, 0.6, speed) != 0.0:
        gone += speed * T
        assert gone < 2 * ALONE_RAD
    assert on.stands


@pytest.mark.parametrize(("size", "push"), [(1.0, 1.0 - LEARNED), (0.05, 0.0)])
def test_it_stands_until_a_hand_or_a_residual_below_its_level(size: float, push: float) -> None:
    on = witness()
    for _ in range(50):
        step(on, 0.6, 0.3)
    assert step(on, 0.2, 0.0) == 0.0
    assert on.stands
    assert step(on, size, 0.0) == pytest.approx(push)
    assert not on.stands


def test_a_push_against_the_motion_is_no_motion_alone() -> None:
    on = witness()
    for _ in range(200):
        step(on, -0.6, 0.3)
    assert not on.stands


def test_one_tick_the_other_way_does_not_wipe_what_was_counted() -> None:
    on = witness()
    for tick in range(60):
        step(on, 0.6 if tick % 5 else -0.6, 0.3)
    assert on.stands


def test_the_arm_backs_away_from_nothing_that_only_learning_shows() -> None:
    level, stated = np.full(3, LEARNED), np.full(3, STATED)
    felt = IndependentResidual(np.array([0.3, 0.5, -0.6]), level, stated, stated)
    np.testing.assert_allclose(beyond_stated(felt), [0.0, 0.1, -0.2])


def test_a_hand_is_remembered_until_the_arm_begins_to_yield_anew() -> None:
    on = witness()
    for size, seen in [(0.5, False), (-0.84, False), (-0.85, True), (0.1, True)]:
        step(on, size, 0.0)
        assert (on.hand, on.leads) == (seen, seen)
    on.begin()
    assert not on.hand


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("size", "speed", "stated", "excess"),
    [
        (1.5, 0.5, 0.4, 1.5 - (CONTACT + COULOMB + 0.5 * VISCOUS)),
        (0.5, 0.5, 0.4, 0.5 - (CONTACT + COULOMB + 0.5 * VISCOUS)),
        (1.5, 0.0, 1.2, 0.3),
    ],
)
def test_the_excess_is_what_a_residual_has_beyond_a_witness(
    way: float, size: float, speed: float, stated: float, excess: float
) -> None:
    on = witness()
    step(on, way * size, way * speed, stated)
    assert on.excess == pytest.approx(way * excess)
