"""Gains that ask for one force at the hand, within what a stiff hand and inertia allow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon.protocol.bounds import MAX_GAIN
from programs.contactctl.balance import (
    FIRMEST_1_S,
    GRIP_M,
    HAND_N_M,
    NO_MASS_S,
    balanced,
    leading_torque,
    levers,
)

LIGHT = 1e-6  # an inertia that bounds nothing [kg m2]
N = 3


def rows(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, N, elements=st.floats(low, high))


@given(
    lever=arrays(np.float64, (20, N), elements=st.floats(GRIP_M, 1.0)),
    threshold=rows(0.05, 5.0),
    inertia=rows(1e-3, 10.0),
    virtual_mass_s=rows(0.0, 0.5),
)
def test_one_force_where_levers_are_long_and_no_gain_beyond_its_bounds(
    lever: np.ndarray, threshold: np.ndarray, inertia: np.ndarray, virtual_mass_s: np.ndarray
) -> None:
    found = balanced(lever, threshold, inertia, virtual_mass_s)
    force = leading_torque(found.gain, threshold) / found.longest
    np.testing.assert_allclose(force, force[0], rtol=0.01)  # of three digits
    digits = 1.005
    assert (found.gain > 0.0).all()
    assert (found.gain <= digits * MAX_GAIN).all()
    assert (found.gain * HAND_N_M * lever.max(axis=0) ** 2 <= digits * FIRMEST_1_S).all()
    massive = virtual_mass_s > NO_MASS_S
    assert (found.gain * inertia <= digits * virtual_mass_s)[massive].all()


@pytest.mark.parametrize(
    ("inertia", "virtual_mass_s", "bound"),
    [
        (LIGHT, 0.05, FIRMEST_1_S / (HAND_N_M * 0.5**2)),  # the stiff hand
        (2.0, 0.05, 0.025),  # would seem lighter than it is
        (2.0, 0.0, FIRMEST_1_S / (HAND_N_M * 0.5**2)),  # pretends to no mass
    ],
)
def test_the_joint_with_the_largest_force_gets_the_largest_allowed_gain(
    inertia: float, virtual_mass_s: float, bound: float
) -> None:
    found = balanced(
        np.linspace([0.25, 0.1], [0.5, 0.1], 1000),
        np.array([1.0, 0.1]),
        np.array([inertia, LIGHT]),
        np.array([virtual_mass_s, 0.05]),
    )
    assert found.gain[0] == pytest.approx(bound, rel=0.02)
    assert found.gain[1] < MAX_GAIN


def test_a_lever_is_the_hands_way_per_angle_and_no_shorter_than_a_grip() -> None:
    jacobian = np.array([[[0.3, 0.0], [0.0, 0.01], [0.4, 0.0]]])
    np.testing.assert_allclose(levers(jacobian), [[0.5, GRIP_M]])


def test_a_joint_without_gain_cannot_be_led() -> None:
    assert leading_torque(np.array([0.0]), np.array([0.2]))[0] == np.inf
