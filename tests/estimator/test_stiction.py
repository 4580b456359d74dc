"""Friction near rest: what the last motion left, and how much of it is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.stiction import Stiction, displacement

PRESLIDING = 0.002
FOLLOWED = 5
PAIR = (0.001, 0.004)


def known(n: int = 1) -> Stiction:
    """All of the friction sticks, and its pre-sliding is known."""
    return Stiction(n, (PRESLIDING, PRESLIDING), np.ones(n), np.ones(n))


def doubtful(least: float = 0.2, most: float = 0.6, n: int = 1) -> Stiction:
    return Stiction(n, PAIR, np.full(n, least), np.full(n, most))


def moved(*displacements: float, stiction: Stiction, sign: float = 0.0) -> Stiction:
    for turned in displacements:
        stiction.step(0, turned, sign)
    return stiction


def believed(stiction: Stiction, i: int = 0) -> tuple[float, float]:
    return float(stiction.held[i]), float(stiction.unknown[i])


# --- pre-sliding and share are known -------------------------------------------------------------


@pytest.mark.parametrize("sign", [0.0, 1.0, -0.4])
@pytest.mark.parametrize(
    ("displacements", "z", "unknown"),
    [
        ((0.0,), 0.0, 1.0),
        ((0.001,), 0.25, 0.75),
        ((0.004,), 1.0, 0.0),
        ((-0.5,), -1.0, 0.0),
        ((0.5, -0.001), 0.5, 0.0),  # turned round within its pre-sliding
        ((0.5, -0.002), 0.0, 0.0),
        ((0.5, -0.3), -1.0, 0.0),
        ((0.5, -0.001, 0.001), 1.0, 0.0),  # and what it does there it can take back
        ((0.001, -0.001), -0.25, 0.75),
    ],
)
def test_the_last_motion_is_kept(
    displacements: tuple[float, ...], z: float, unknown: float, sign: float
) -> None:
    stiction = moved(*displacements, stiction=known(), sign=sign)
    assert believed(stiction) == pytest.approx((z - sign, unknown))


@given(displacements=st.lists(st.floats(-0.01, 0.01), max_size=30))
def test_the_unknown_share_never_grows(displacements: list[float]) -> None:
    stiction = known()
    before = 1.0
    for turned in displacements:
        stiction.step(0, turned, 0.0)
        assert stiction.unknown[0] <= before + 1e-9
        before = stiction.unknown[0]


# --- they are not --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("displacements", "sign", "low", "high"),
    [
        ((0.0,), 0.0, -0.6, 0.6),
        ((0.5,), 0.0, 0.2, 0.6),  # all of them slide: only the share is not known
        ((0.5,), 1.0, 0.0, 0.0),  # and in motion that is no matter
        ((0.5,), -1.0, 0.4, 1.2),
        # z is -1 for 1 mrad of pre-sliding, 0.5 for 4 mrad
        ((0.5, -0.002), 0.0, -0.6, 0.3),
        ((0.5, -0.002), 1.0, -1.2, -0.1),
        ((0.5, -0.002), -1.0, 0.0, 0.9),
        ((0.5, -0.009), 0.0, -0.6, -0.2),
    ],
)
def test_held_friction_is_the_middle_of_what_is_possible(
    displacements: tuple[float, ...], sign: float, low: float, high: float
) -> None:
    stiction = moved(*displacements, stiction=doubtful(), sign=sign)
    assert believed(stiction) == pytest.approx((0.5 * (low + high), 0.5 * (high - low)))


@given(
    begins=st.floats(-1.0, 1.0),
    pair=st.tuples(st.floats(0.0001, 0.01), st.floats(1.0, 40.0)),
    shares=st.tuples(*3 * [st.floats(0.0, 1.0)]),
    steps=st.lists(st.tuples(st.floats(-0.01, 0.01), st.floats(-1.0, 1.0)), max_size=30),
)
def test_true_friction_is_within_the_unknown_share(
    begins: float,
    pair: tuple[float, float],
    shares: tuple[float, float, float],
    steps: list[tuple[float, float]],
) -> None:
    least, share, most = sorted(shares)
    presliding = (pair[0], pair[0] * pair[1])
    stiction = Stiction(1, presliding, np.array([least]), np.array([most]))
    followed = np.geomspace(*presliding, FOLLOWED)
    true = np.full(FOLLOWED, begins)
    for turned, sign in steps:
        true = np.clip(true + turned / followed, -1.0, 1.0)
        stiction.step(0, turned, sign)
        off = np.abs(share * (true - sign) - stiction.held[0])
        assert off.max() <= stiction.unknown[0] + 1e-9
        assert stiction.unknown[0] <= most + 1e-9


def test_the_unknown_share_at_rest_is_predicted_in_motion() -> None:
    stiction = doubtful()
    assert stiction.unknown_at_rest(0) == pytest.approx(0.6)  # nothing is known
    moved(0.5, stiction=stiction, sign=1.0)
    assert believed(stiction) == pytest.approx((0.0, 0.0))
    will_be = stiction.unknown_at_rest(0)
    assert will_be == pytest.approx(0.2)  # of the share
    moved(0.0, stiction=stiction, sign=0.0)
    assert stiction.unknown[0] == pytest.approx(will_be)
    moved(-0.002, stiction=stiction)  # within the pre-sliding of some
    assert stiction.unknown_at_rest(0) == pytest.approx(0.45) == pytest.approx(stiction.unknown[0])


def test_restart_forgets_one_joint() -> None:
    stiction = doubtful(n=2)
    for i in range(2):
        stiction.step(i, 0.5, 0.0)
    stiction.restart(0)
    np.testing.assert_array_equal(stiction.ends[0, :, 0], -np.ones(FOLLOWED))
    np.testing.assert_array_equal(stiction.ends[1, :, 0], np.ones(FOLLOWED))
    assert believed(stiction) == (0.0, 0.6)
    assert believed(stiction, 1) == pytest.approx((0.4, 0.2))
    stiction.step(0, 0.0, 0.0)
    assert believed(stiction) == pytest.approx((0.0, 0.6))


def test_before_the_first_step_nothing_is_known() -> None:
    assert believed(known()) == (0.0, 1.0)
    assert believed(doubtful()) == (0.0, 0.6)


# --- what moves it -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("theta_dot", "q_dot", "has_gap", "turned"),
    [
        (0.004, 0.0, True, 0.00004),  # the rotor runs through its gap, the link stands
        (0.004, 0.0, False, 0.00001),  # the same without a gap: an error of the velocity
        (-0.3, 0.3, True, -0.003),
        (-0.3, 0.3, False, 0.00001),
        (0.002, 0.009, True, 0.00001),  # both creep
        (0.002, -0.011, True, 0.00002),
    ],
)
def test_the_displacement_of_a_rotor_depends_on_its_gap(
    theta_dot: float, q_dot: float, has_gap: bool, turned: float
) -> None:
    moved = 0.00001
    assert displacement(theta_dot, q_dot, moved, has_gap, 0.01) == pytest.approx(turned)
