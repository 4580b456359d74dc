"""Limits of setpoints: velocity, acceleration, and no joint through its limit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.arrays import Vector
from daemon.motion.limits import Limits
from tests.examples import scaled

DT = 0.01
LIMITS = Limits(
    lower=np.array([-1.0, -0.1, 0.0]),
    upper=np.array([1.0, 0.1, 2.0]),
    velocity=np.array([1.0, 0.5, 2.0]),
    acceleration=np.array([4.0, 5.0, 0.5]),
    reaction_s=DT,
)
TAU = 4 * DT
TINY = 1e-12

anything = st.lists(
    st.floats(allow_nan=True, allow_infinity=True) | st.floats(-3.0, 3.0), min_size=3, max_size=3
).map(np.array)
share = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).map(np.array)
signed = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)
position = st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3).map(np.array)


@given(q=position, desired=anything, before=signed)
def test_velocity_is_never_beyond_its_bound(q: Vector, desired: Vector, before: Vector) -> None:
    v = LIMITS.bound_velocity(q, desired, before * LIMITS.velocity, DT)
    assert np.isfinite(v).all()
    assert (np.abs(v) <= LIMITS.velocity + TINY).all()


@given(q=position, desired=anything, before=signed)
def test_change_is_within_acceleration_except_in_the_funnel(
    q: Vector, desired: Vector, before: Vector
) -> None:
    before = before * LIMITS.velocity
    v = LIMITS.bound_velocity(q, desired, before, DT)
    up, down = LIMITS.funnel(LIMITS.upper - q), LIMITS.funnel(q - LIMITS.lower)
    harder = np.abs(v - before) > LIMITS.acceleration * DT + TINY
    # Where it brakes harder, it moved towards a limit and leaves exactly what the funnel leaves.
    towards_upper = harder & (v < before)
    towards_lower = harder & (v > before)
    np.testing.assert_allclose(v[towards_upper], up[towards_upper], atol=TINY)
    np.testing.assert_allclose(v[towards_lower], -down[towards_lower], atol=TINY)


@given(
    start=share,
    goals=st.lists(anything, min_size=1, max_size=4),
    dt=st.sampled_from([0.001, 0.01, 0.05]),
)
def test_integrated_it_never_crosses_a_joint_limit(
    start: Vector, goals: list[Vector], dt: float
) -> None:
    limits = replace(LIMITS, reaction_s=dt)
    q = LIMITS.lower + start * (LIMITS.upper - LIMITS.lower)
    v = np.zeros(3)
    for goal in goals:
        for _ in range(60):
            before, v = v, limits.bound_velocity(q, goal, v, dt)
            q = q + v * dt
            assert (q >= LIMITS.lower - 1e-9).all()
            assert (q <= LIMITS.upper + 1e-9).all()
            # From a state that can stop in time, stopping needs no more than the acceleration.
            assert (np.abs(v - before) <= LIMITS.acceleration * dt + 1e-9).all()


@given(
    acceleration=st.floats(0.5, 500.0),
    velocity=st.floats(0.05, 20.0),
    period=st.sampled_from([0.001, 0.01, 0.05]),
    lag=st.floats(0.0, 0.03),
    gain=st.one_of(st.just(math.inf), st.floats(1.0, 8.0)),
    away=st.floats(0.0, 1.0),
)
@settings(max_examples=scaled(40))
def test_with_a_drive_that_latches_late_interpolates_and_lags_it_stops_before_the_limit(
    acceleration: float, velocity: float, period: float, lag: float, gain: float, away: float
) -> None:
    """Pushed towards the limit for as long as it takes, with and without the soft stop."""
    one = np.ones(1)
    limits = Limits(-100.0 * one, 0.0 * one, velocity * one, acceleration * one, 1.5 * period + lag)
    q = -away * one
    sent, reference, speed, steps = np.zeros(1), 0.0, 0.0, 5
    follow = 1.0 - math.exp(-period / steps / lag) if lag > 0 else 1.0
    for _ in range(400):
        latched = sent[0]  # what this SYNC finds was made from the samples of the one before
        desired = velocity * one if gain == math.inf else limits.soft_stop(q, velocity * one, gain)
        sent = limits.bound_velocity(q, desired, sent, period)
        rise = (latched - reference) / steps
        for _ in range(steps):
            reference += rise
            speed += follow * (reference - speed)
            q = q + speed * period / steps
            assert q[0] <= 1e-6


def test_commanded_motion_comes_as_close_to_a_limit_as_one_likes() -> None:
    for sign in (-1.0, 1.0):
        q, v, fastest = LIMITS.lower / 2 + LIMITS.upper / 2, np.zeros(3), np.zeros(3)
        for _ in range(1500):
            v = LIMITS.bound_velocity(q, np.full(3, sign * 9.0), v, DT)
            fastest = np.maximum(fastest, np.abs(v))
            q = q + v * DT
        assert fastest[0] == pytest.approx(1.0)
        assert np.abs(v).max() < 1e-3
        left = LIMITS.upper - q if sign > 0 else q - LIMITS.lower
        assert (left >= 0.0).all()
        assert (left < 1e-3).all()


@pytest.mark.parametrize("beyond", [0.0, 1e-6, 0.002, 0.1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_push_that_passes_a_limit_is_led_back(sign: float, beyond: float) -> None:
    q = (LIMITS.upper if sign > 0 else LIMITS.lower) + sign * beyond
    v = LIMITS.soft_stop(q, np.full(3, sign * 9.0), 8.0)
    np.testing.assert_allclose(v, -sign * 8.0 * beyond, atol=1e-12)


def test_away_from_the_limits_the_soft_stop_changes_nothing() -> None:
    desired = np.array([0.5, 0.2, -0.5])
    np.testing.assert_array_equal(
        LIMITS.soft_stop(np.array([0.0, 0.0, 1.0]), desired, 8.0), desired
    )


@pytest.mark.parametrize("distance", [-0.5, -1e-3, -1e-9, 0.0, 1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.12])
def test_around_the_border(distance: float) -> None:
    q = LIMITS.upper - distance
    v = LIMITS.bound_velocity(q, np.full(3, 9.0), LIMITS.velocity, DT)
    if distance <= 0.0:
        assert not v.any()  # at and beyond the limit: not a step further, whatever came before
    else:
        a = LIMITS.acceleration
        assert (v > 0.0).all()
        # The delay at v and braking from it fit into the distance.
        assert (v * TAU + v**2 / (2 * a) <= distance + TINY).all()
        at_bound = np.isclose(v, LIMITS.velocity) | np.isclose(v, LIMITS.velocity - a * DT)
        assert (at_bound | np.isclose(v * TAU + v**2 / (2 * a), distance)).all()


def test_beyond_a_limit_the_way_back_is_open() -> None:
    v = LIMITS.bound_velocity(LIMITS.upper + 0.2, np.full(3, -9.0), np.zeros(3), DT)
    np.testing.assert_allclose(v, -LIMITS.acceleration * DT)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_velocity_that_is_not_finite_decelerates(bad: float) -> None:
    q, before = np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.3, 0.3])
    v = LIMITS.bound_velocity(q, np.array([bad, 0.3, 0.3]), before, DT)
    np.testing.assert_allclose(v, [0.5 - 4.0 * DT, 0.3, 0.3])


def test_a_desire_within_all_limits_passes_unchanged() -> None:
    desired = np.array([0.02, -0.01, 0.003])
    q = np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(LIMITS.bound_velocity(q, desired, np.zeros(3), DT), desired)


def test_which_joints_stand_outside() -> None:
    assert LIMITS.outside(np.array([-1.0, 0.1, 2.0])).tolist() == [False] * 3
    assert LIMITS.outside(np.array([-1.001, 0.101, 1.0])).tolist() == [True, True, False]
    lenient = replace(LIMITS, tolerance=0.01)
    assert lenient.outside(np.array([-1.009, 0.109, 2.009])).tolist() == [False] * 3
    assert lenient.outside(np.array([-1.011, 0.111, 2.011])).tolist() == [True] * 3


def test_a_limit_is_nearer_by_what_the_link_may_fall() -> None:
    q, still, fast = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.full(3, 9.0)
    down, up = np.array([0.9, 0.0, 0.0]), np.array([0.0, 0.05, 1.5])
    play = np.array((down, up))
    for sign, fallen in ((1.0, q + up), (-1.0, q - down)):
        bounded = LIMITS.bound_velocity(q, sign * fast, LIMITS.velocity * sign, DT, play)
        expected = LIMITS.bound_velocity(fallen, sign * fast, LIMITS.velocity * sign, DT)
        np.testing.assert_allclose(bounded, expected)
        soft = LIMITS.soft_stop(q, sign * fast, 8.0, play)
        np.testing.assert_allclose(soft, LIMITS.soft_stop(fallen, sign * fast, 8.0))
    assert LIMITS.bound_velocity(q, still, still, DT, play)[2] == 0.0


def test_a_joint_whose_position_is_not_a_number_does_not_move() -> None:
    q = np.array([np.nan, 0.0, 1.0])
    v = LIMITS.bound_velocity(q, np.full(3, 0.004), np.full(3, 0.004), DT)
    assert v[0] == 0.0
    assert (v[1:] > 0.0).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("what", ["before", "dt"])
def test_where_the_past_is_no_number_there_is_no_velocity(bad: float, what: str) -> None:
    """The drives are commanded to stop then; a finite one would drop the limit on acceleration."""
    before, dt = np.array([0.1, bad if what == "before" else 0.1, 0.1]), DT
    v = LIMITS.bound_velocity(np.zeros(3), before, before, bad if what == "dt" else dt)
    assert np.isnan(v).tolist() == [what == "dt", True, what == "dt"]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_soft_stop_stands_where_the_position_is_not_a_number(bad: float) -> None:
    q, play = np.array([0.0, bad, 0.0]), np.array([[0.0, 0.0, bad], [0.0] * 3])
    v = LIMITS.soft_stop(q, np.full(3, 0.2), 8.0, play)
    np.testing.assert_array_equal(v, [0.2, 0.0, 0.0])


SHORT, LONG = np.zeros(2), np.zeros(4)


@pytest.mark.parametrize(
    "given",
    [(SHORT, *2 * [np.zeros(3)]), (np.zeros(3), LONG, np.zeros(3)), (*2 * [np.zeros(3)], SHORT)],
)
def test_arrays_of_another_arm_are_refused(given: tuple[Vector, Vector, Vector]) -> None:
    with pytest.raises(ValueError, match=r"it must be an array of shape \(3,\)"):
        LIMITS.bound_velocity(*given, DT)
    with pytest.raises(ValueError, match=r"play is \(1, 3\)"):
        LIMITS.soft_stop(np.zeros(3), np.zeros(3), 8.0, np.zeros((1, 3)))
