"""Levels in force: friction that passes the residual's filter, raise, and the share learned."""

from typing import Any

import numpy as np
import pytest

from common.errors import ModelError
from estimator.interval import ROW, Interval
from estimator.levels import Levels
from estimator.residual import Residual
from estimator.settings import EstimatorSettings, Variant
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

T, GAIN = 0.01, 25.0
POLE = (2.0 - GAIN * T) / (2.0 + GAIN * T)
NONE = np.zeros(2)
CONTACT, COLLISION, PER_SPEED = np.array([0.6, 2.0]), np.array([3.0, 4.0]), np.array([0.2, 0.1])
TRANSMISSION = Transmission(
    joints=("loose", "rigid"),
    torque_constant=np.ones(2),
    rotor_inertia=NONE,
    half_gap=np.array([0.01, 0.0]),
    motor_coulomb=np.array([1.5, 0.5]),
    motor_viscous=NONE,
    link_coulomb=np.array([0.5, 0.0]),
    link_viscous=NONE,
)
COULOMB = (2.0, 0.5)
CROSSING = 0.7


def levels(share: float = 1.0, **settings: Any) -> Levels:
    """Those of two joints that need `share` of their configured levels."""
    chosen = {"gain": GAIN, "stiction_share": 0.25, "unknown_side_share": 0.5} | settings
    thresholds = Thresholds(CONTACT, COLLISION, per_speed=PER_SPEED)
    made = Levels(TRANSMISSION, thresholds, EstimatorSettings(**chosen))
    np.asarray(made.share)[:] = share
    np.asarray(made.crossing)[:] = CROSSING
    return made


def put(made: Levels, uncertainty: float = 0.0, speed: float = 0.0, dt: float = T) -> list[float]:
    return [made.put_in_force(i, 0.0, uncertainty, speed, dt) for i in range(2)]


# --- friction ------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [1.0, 0.4])
@pytest.mark.parametrize(
    ("rest", "unknown", "factor"),
    [
        (1.0, 1.0, 1.0),  # at rest with nothing known
        (1.0, 0.25, 1.0),
        (0.0, 0.25, 1.0),  # a turn that is not over
        (0.5, 0.0, 1.0),
        (0.0, 0.0, 1.3),  # in motion nothing may be off
        (0.5, 0.25, 0.7),
    ],
)
@pytest.mark.parametrize("load", [0.0, 1.5])
def test_friction_that_may_be_off(
    rest: float, unknown: float, factor: float, share: float, load: float
) -> None:
    """A level learned in motion says nothing about it."""
    made = levels(share)
    for i in range(2):
        # rest**4: exp(-(v / 0.05)^2) at twice the speed
        expected = pytest.approx((COULOMB[i] * factor + load) * (unknown + 0.25 * rest**4))
        assert made.friction_at(i, rest, unknown, factor, load) == expected
        made.set_friction(i, rest, unknown, factor, load)
        made.end(i)
        assert made.begin[i] == expected


@pytest.mark.parametrize("seed", range(4))
def test_a_residual_of_as_much_friction_shows_as_much(seed: int) -> None:
    """Over intervals of any length, some of which go on over several ticks."""
    rng = np.random.default_rng(seed)
    made, interval = levels(), Interval(2)
    residual = Residual([Variant(kind="classical")], GAIN, T, 2)
    for _ in range(200):
        rest, unknown, dt = rng.random(), rng.random(), rng.choice([0.0, T, 2 * T, 0.2])
        for i in (1, 0):
            made.set_friction(i, rest, unknown, 1.2, 0.0)
            interval.now[ROW["stiction"]] = made.friction_at(i, rest, unknown, 1.2, 0.0)
            if dt > 0.0:
                interval.integrate(i, dt)
                residual.step(i, interval.impulse, 0.0, True, dt)
                made.integrate(i, dt, residual.pole, residual.share)
                interval.end(i)
                made.end(i)
        np.testing.assert_allclose(made.friction, residual.values[0], rtol=1e-12)
        assert np.min(made.friction) >= 0.0


def test_friction_grows_and_fades_as_the_filter_does() -> None:
    made, share = levels(), 2.0 * GAIN / (2.0 + GAIN * T)
    made.set_friction(0, 1.0, 0.0, 1.0, 0.0)
    made.end(0)
    whole = 0.25 * COULOMB[0]
    for k in range(1, 30):
        made.integrate(0, T, POLE, share)
        assert made.friction[0] == pytest.approx(whole * (1.0 - POLE**k))
    before = made.friction[0]
    made.set_friction(0, 0.0, 0.0, 1.0, 0.0)
    made.end(0)
    for k in range(1, 30):
        made.integrate(0, T, POLE, share)
        assert made.friction[0] == pytest.approx(before * POLE**k)
    assert made.friction[1] == 0.0


# --- what is raised ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("periods", "missing"),
    [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.5, 0.2), (3.0, 0.4), (5.0, 1.2), (9.0, 1.2)],
)
@pytest.mark.parametrize("unknown", [False, True])
@pytest.mark.parametrize("shaken", [False, True])
@pytest.mark.parametrize(
    ("crossing", "share", "needed"),
    [(False, 0.4, 0.0), (True, 0.4, CROSSING - 0.4), (True, 0.6, CROSSING - 0.6), (True, 0.9, 0.0)],
)
def test_uncertainty_adds_missing_samples_side_and_shock(
    periods: float,
    missing: float,
    unknown: bool,
    shaken: bool,
    crossing: bool,
    share: float,
    needed: float,
) -> None:
    """Shares of the configured level; a rigid joint has no side to be unsure of, and is shaken all
    the same."""
    made, shock = levels(share), max(0.6 - share, 0.0) * shaken
    for i, of_gap in enumerate((0.5 * unknown + max(needed, shock), shock)):
        found = made.uncertainty(i, unknown, crossing, shaken, periods)
        assert found == pytest.approx((missing + of_gap) * CONTACT[i])


def test_both_levels_are_raised_at_once_and_the_raise_fades_with_half_the_gain() -> None:
    made = levels()
    np.testing.assert_allclose(put(made), CONTACT)
    np.testing.assert_allclose(put(made, uncertainty=0.4), CONTACT + 0.4)
    np.testing.assert_allclose(made.collision, COLLISION + 0.4)
    left = 0.4
    for dt in (T, T, 3 * T, 0.5 * T, 12 * T):
        left *= np.exp(-0.5 * GAIN * dt)
        np.testing.assert_allclose(put(made, dt=dt), CONTACT + left)
    np.testing.assert_allclose(put(made, uncertainty=0.1), CONTACT + 0.1)  # the larger of both


def test_the_raise_is_added_to_friction() -> None:
    made = levels()
    np.asarray(made.friction)[:] = 0.3
    np.testing.assert_allclose(put(made, uncertainty=0.4), CONTACT + 0.7)
    fading = 0.4 * np.exp(-0.5 * GAIN * T)
    np.testing.assert_allclose(put(made), CONTACT + 0.3 + fading)
    np.testing.assert_allclose(made.above, 0.3 + fading)
    np.testing.assert_allclose(made.friction, 0.3)


# --- both levels ---------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_the_needed_share_scales_the_contact_level_alone(share: float) -> None:
    made = levels(share)
    np.asarray(made.friction)[:] = 0.3
    for i in range(2):
        found = made.put_in_force(i, 0.25, 0.1, 0.5, T)
        grown = 0.5 * PER_SPEED[i]
        above = 0.1 + 0.3 + share * (0.25 + grown)
        assert made.above[i] == pytest.approx(above)
        assert found == made.contact[i] == pytest.approx(made.contact_at(i, above))
        assert found == pytest.approx(share * CONTACT[i] + above)
        beside = 0.1 + 0.3 + share * 0.25
        assert made.collision[i] == pytest.approx(COLLISION[i] + grown + beside)


def test_levels_may_grow_with_speed() -> None:
    made = levels()
    for speed in (0.0, 0.5, 2.0):
        np.testing.assert_allclose(put(made, speed=speed), CONTACT + speed * PER_SPEED)
        assert [made.configured(i, speed) for i in range(2)] == put(made, speed=speed)
    np.testing.assert_allclose(put(made), CONTACT)


def test_reading_a_level_changes_nothing() -> None:
    made = levels(0.4)
    put(made, uncertainty=0.4)
    names = ("begin", "friction", "raised", "above", "contact", "collision", "share", "crossing")
    before = [np.array(getattr(made, name)) for name in names]
    made.friction_at(0, 1.0, 1.0, 1.0, 0.0)
    made.contact_at(0, 0.7)
    made.uncertainty(0, True, True, True, 4.0)
    for name, values in zip(names, before, strict=True):
        np.testing.assert_array_equal(getattr(made, name), values, name)


def test_the_part_above_is_summed_without_a_tick() -> None:
    """As after a memory is read: what fades is not taken anew."""
    made = levels(0.4)
    for name, value in {"friction": 0.3, "raised": 0.1}.items():
        np.asarray(getattr(made, name))[:] = value
    made.add_up(0, 0.25, 0.5)
    assert made.above[0] == pytest.approx(0.1 + 0.3 + 0.4 * (0.25 + 0.5 * PER_SPEED[0]))
    assert (made.raised[0], made.friction[0], made.above[1]) == (0.1, 0.3, 0.0)


def test_reset_clears_the_raise_of_one_joint() -> None:
    """The interval goes on: what rubs at its beginning is known still."""
    made = levels()
    for i in range(2):
        made.set_friction(i, 1.0, 1.0, 1.0, 0.0)
        made.end(i)
        made.integrate(i, T, POLE, 20.0)
    raised = put(made, uncertainty=0.4)
    made.reset(0)
    assert (made.friction[0], made.raised[0]) == (0.0, 0.0)
    assert made.begin[0] == pytest.approx(1.25 * COULOMB[0])
    again = put(made)
    assert again[0] == pytest.approx(CONTACT[0])
    assert again[1] > raised[1] - 0.05 > CONTACT[1] + 0.4


def test_thresholds_of_another_arm_are_refused() -> None:
    other = Thresholds(np.array([1.0]), np.array([3.0]))
    with pytest.raises(ModelError, match="thresholds for 1 joints, the arm has 2"):
        Levels(TRANSMISSION, other, EstimatorSettings())
