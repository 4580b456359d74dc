"""No velocity beyond its bound, no change beyond the acceleration, no joint through its limit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from daemon.limits import Limits

Vector = NDArray[np.float64]
DT = 0.01
LIMITS = Limits(
    lower=np.array([-1.0, -0.1, 0.0]),
    upper=np.array([1.0, 0.1, 2.0]),
    velocity=np.array([1.0, 0.5, 2.0]),
    acceleration=np.array([4.0, 5.0, 0.5]),
)
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
    up, down = LIMITS.funnel(LIMITS.upper - q, DT), LIMITS.funnel(q - LIMITS.lower, DT)
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
    q = LIMITS.lower + start * (LIMITS.upper - LIMITS.lower)
    v = np.zeros(3)
    for goal in goals:
        for _ in range(60):
            before, v = v, LIMITS.bound_velocity(q, goal, v, dt)
            q = q + v * dt
            assert (q >= LIMITS.lower - 1e-9).all()
            assert (q <= LIMITS.upper + 1e-9).all()
            # From a state that can stop in time, stopping needs no more than the acceleration.
            assert (np.abs(v - before) <= LIMITS.acceleration * dt + 1e-9).all()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_at_full_speed_into_a_limit_it_comes_close_and_stops(sign: float) -> None:
    limits = Limits(
        lower=np.array([-1.0]),
        upper=np.array([1.0]),
        velocity=np.array([1.0]),
        acceleration=np.array([4.0]),
    )
    q, v, fastest = np.zeros(1), np.zeros(1), 0.0
    for _ in range(400):
        v = limits.bound_velocity(q, np.array([sign * 9.0]), v, DT)
        fastest = max(fastest, abs(v[0]))
        q = q + v * DT
    assert fastest == pytest.approx(1.0)
    assert abs(v[0]) < 1e-3
    assert 1.0 - 1e-3 < sign * q[0] <= 1.0 + 1e-12


@pytest.mark.parametrize("distance", [-0.5, -1e-3, -1e-9, 0.0, 1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.12])
def test_around_the_border(distance: float) -> None:
    q = LIMITS.upper - distance
    v = LIMITS.bound_velocity(q, np.full(3, 9.0), LIMITS.velocity, DT)
    if distance <= 0.0:
        assert not v.any()  # at and beyond the limit: not a step further, whatever came before
    else:
        a = LIMITS.acceleration
        assert (v > 0.0).all()
        # The interval at v and braking from it fit into the distance.
        assert (v * DT + v**2 / (2 * a) <= distance + TINY).all()
        at_bound = np.isclose(v, LIMITS.velocity) | np.isclose(v, LIMITS.velocity - a * DT)
        assert (at_bound | np.isclose(v * DT + v**2 / (2 * a), distance)).all()


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


def test_a_joint_whose_position_is_not_a_number_does_not_move() -> None:
    q = np.array([np.nan, 0.0, 1.0])
    v = LIMITS.bound_velocity(q, np.full(3, 0.004), np.full(3, 0.004), DT)
    assert v[0] == 0.0
    assert (v[1:] > 0.0).all()
