"""Admittance, eq. (15): velocity from the thresholded residual, and its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.motion.admittance import (
    GAIN_RAMP_S,
    GROWS,
    LEAKS,
    AdmittanceLaw,
    Allowance,
    AllowanceSettings,
    Assist,
    Gains,
)

DT = 0.01
GAIN = np.array([0.08, 0.5, 0.0])
LAW = AdmittanceLaw(virtual_mass_s=np.array([0.05, 0.05, 0.2]), velocity=np.full(3, 0.5))


def settled(push: list[float]) -> np.ndarray:
    velocity = np.zeros(3)
    for _ in range(300):
        velocity = LAW.velocity_after(velocity, GAIN, np.array(push), DT)
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


def test_the_virtual_mass_is_each_joints_time_constant() -> None:
    dt, velocity, gain = 1e-4, np.zeros(3), np.full(3, 0.08)
    for _ in range(500):  # 0.05 s
        velocity = LAW.velocity_after(velocity, gain, np.ones(3), dt)
    expected = 0.08 * (1 - np.exp([-1.0, -1.0, -0.25]))
    np.testing.assert_allclose(velocity, expected, rtol=2e-3)


def test_without_virtual_mass_it_follows_at_once() -> None:
    law = replace(LAW, virtual_mass_s=np.zeros(3))
    after = law.velocity_after(np.full(3, 0.3), GAIN, np.array([1.0, 0.0, 1.0]), DT)
    np.testing.assert_allclose(after, [0.08, 0.0, 0.0])


@given(before=st.floats(-0.5, 0.5), push=st.floats(-1e6, 1e6), dt=st.floats(1e-4, 10.0))
def test_for_every_interval_it_ends_between_before_and_the_target(
    before: float, push: float, dt: float
) -> None:
    after = LAW.velocity_after(np.full(3, before), GAIN, np.full(3, push), dt)
    target = np.clip(GAIN * push, -LAW.velocity, LAW.velocity)
    assert (np.abs(after) <= 0.5 + 1e-12).all()
    assert (after >= np.minimum(before, target) - 1e-12).all()
    assert (after <= np.maximum(before, target) + 1e-12).all()


@given(
    changes=st.lists(
        st.tuples(st.integers(0, 2), st.floats(0.0, 5.0), st.integers(0, 100)), max_size=6
    )
)
def test_a_gain_moves_evenly_and_arrives(changes: list[tuple[int, float, int]]) -> None:
    gains, goal = Gains(GAIN), GAIN.copy()
    for joint, value, ticks in changes:
        before = gains.value.copy()
        gains.change(joint, value)
        np.testing.assert_array_equal(gains.value, before)  # not at once
        goal[joint] = value
        for _ in range(ticks):
            before = gains.value
            gains.step(DT)
            assert (np.abs(gains.value - before) <= 5.0 * DT / GAIN_RAMP_S + 1e-9).all()
    for _ in range(51):
        gains.step(DT)
    np.testing.assert_allclose(gains.value, goal, atol=1e-12)
    np.testing.assert_array_equal(GAIN, [0.08, 0.5, 0.0])  # the configuration's stay


BOUNDS = AllowanceSettings(max_duration_s=10.0, max_excursion=0.5)


@pytest.mark.parametrize(
    ("spent_s", "q", "words"),
    [
        (10.0, [0.5, -0.5], ""),
        (10.001, [0.0, 0.0], "more than 10 s"),
        (1.0, [0.0, -0.501], "further than 0.5 rad"),
        (1.0, [0.501, 0.0], "further than 0.5 rad"),
    ],
)
def test_bounds(spent_s: float, q: list[float], words: str) -> None:
    allowance = Allowance(BOUNDS, 2)
    allowance.take(np.zeros(2))
    allowance.spend(spent_s)
    reached = allowance.bound_reached(np.array(q))
    assert words in reached
    assert bool(reached) is bool(words)


def test_small_steps_add_up_until_it_is_armed_anew() -> None:
    """A biased residual takes the arm a little, lets go, and takes it again."""
    allowance, q = Allowance(BOUNDS, 2), np.zeros(2)
    steps = 0
    while steps < 100:
        steps += 1
        allowance.take(q)
        q = q + np.array([0.03, -0.01])
        allowance.spend(0.1)
        reached = allowance.bound_reached(q)
        allowance.leave(q)
        allowance.recover(3.0)
        if reached:
            break
    assert reached == "led further than 0.5 rad since `arm` (admittance.max_excursion)"
    assert steps == 17
    allowance.renew()
    allowance.take(q)
    assert not allowance.bound_reached(q + 0.5)


def test_what_comes_back_is_not_away() -> None:
    allowance = Allowance(BOUNDS, 1)
    for _ in range(50):
        for end in (0.4, 0.0):
            allowance.take(np.array([0.4 - end]))
            assert not allowance.bound_reached(np.array([end]))
            allowance.leave(np.array([end]))


def test_time_comes_back_only_as_it_went() -> None:
    """Quiet that is short beside what came before renews nothing."""
    allowance = Allowance(BOUNDS, 1)
    allowance.take(np.zeros(1))
    touches = 0
    while not allowance.bound_reached(np.zeros(1)):
        allowance.recover(2.0)
        allowance.spend(3.0)
        touches += 1
        assert touches < 100
    assert touches == 9  # past 10 s with a second more each time
    for _ in range(100):
        allowance.recover(1.0)
    allowance.spend(10.0)
    assert not allowance.bound_reached(np.zeros(1))


def test_a_contact_during_another_does_not_move_home() -> None:
    allowance = Allowance(BOUNDS, 1)
    allowance.take(np.zeros(1))
    allowance.take(np.full(1, 0.4))
    assert allowance.home == 0.0
    assert allowance.bound_reached(np.full(1, 0.6))


def assisted(*, seconds: float = 3.0, push: float = 1.0, excess: float = 0.5) -> Assist:
    """Assist of a hand that has pushed three joints for so long."""
    assist = Assist(LAW.velocity)
    for _ in range(round(seconds / DT)):
        assist.step(GAIN, np.full(3, push), np.full(3, excess), DT)
    return assist


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_push_that_lasts_is_assisted_by_what_it_has_beyond_a_witness(way: float) -> None:
    wanted = way * np.minimum(0.5 * GAIN * GROWS / LEAKS, LAW.velocity)
    at_once, later = (
        assisted(seconds=0.05, push=way, excess=0.5 * way),
        assisted(push=way, excess=0.5 * way),
    )
    np.testing.assert_allclose(later.velocity, wanted, rtol=1e-2)
    assert (np.abs(at_once.velocity) <= 0.2 * np.abs(wanted)).all()
    bounded = assisted(push=way, excess=1e3 * way)
    np.testing.assert_allclose(bounded.velocity, way * LAW.velocity * (GAIN > 0.0))


@pytest.mark.parametrize(
    ("push", "excess", "ends_s"),
    [
        (0.0, -1.0, DT),  # let go
        (-0.5, 0.5, DT),  # a hand the other way
        (0.5, -0.5, 0.2),  # what no hand but friction might be
        (0.5, 0.0, 5.0),
    ],
)
def test_an_assist_ends_without_a_hand(push: float, excess: float, ends_s: float) -> None:
    assist, before = assisted(), assisted().velocity
    for tick in range(round(ends_s / DT)):
        assist.step(GAIN, np.full(3, push), np.full(3, excess), DT)
        after = assist.velocity
        assert (after >= 0.0).all() if push >= 0.0 else (after <= 0.0).all(), tick
        assert (np.abs(after) < np.abs(before) + 1e-12).all()
    assert (np.abs(assist.velocity) < 1e-2 * (1.0 + (push < 0.0))).all()


def test_an_assist_ends_with_its_gain() -> None:
    assist = assisted()
    assert assist.velocity.any()
    assist.step(np.zeros(3), np.full(3, 1.0), np.full(3, 0.5), DT)
    assert not assist.velocity.any()
