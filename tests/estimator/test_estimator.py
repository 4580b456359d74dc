"""The estimator's chain on an arm whose masses, friction, gaps and motors are not the model's."""

from collections.abc import Callable

import numpy as np
import pytest

from common.errors import ModelError
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.motor_position import Side
from estimator.settings import EstimatorSettings, Variant
from estimator.thresholds import Thresholds

T = 0.01
BARE = Variant(kind="classical", friction=False, rotor_inertia=False)
VARIANTS = (BARE, Variant(kind="two_mass"), Variant(rotor_inertia=False))


CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
COULOMB = np.array([0.9, 0.7, 0.4, 0.35, 0.12, 0.05, 0.04])


@pytest.fixture
def believing(make_transmission, romeo) -> Callable[..., Estimator]:
    """One that believes in stiction between two shares; it does not learn."""

    def build(least: float, most: float, **settings: object) -> Estimator:
        transmission = make_transmission(least_stiction=least, most_stiction=most)
        chosen = EstimatorSettings(**({"learning": False} | settings))
        return Estimator(romeo, transmission, chosen, Thresholds(CONTACT, 6 * CONTACT), T)

    return build


def residuals(estimates: list) -> np.ndarray:
    return np.array([estimate.residual for estimate in estimates])


def worst(estimates: list, start: int = 100) -> np.ndarray:
    return np.abs(residuals(estimates[start:])).max(axis=0)


# Contact-free motion


@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize(("most", "better"), [(0.0, 2.3), (1.0, 1.8)])
def test_no_false_alarm_and_far_better_than_classical(
    believing, sine_motion, source: str, most: float, better: float
) -> None:
    """The more so where it is known that this arm's friction does not stick."""
    estimates = sine_motion.replay(believing(0.0, most, beside=VARIANTS, motor_position=source))
    assert not any(estimate.contacts for estimate in estimates)
    assert not any(estimate.thresholded.any() for estimate in estimates)
    limit = np.array([0.48, 0.45, 0.28, 0.25, 0.07, 0.05, 0.06])
    assert np.all(worst(estimates) < limit) or most > 0.0
    classical = np.abs([e.beside["classical"] for e in estimates[100:]]).max(axis=0)
    assert np.all(classical > better * worst(estimates))


@pytest.mark.parametrize("source", ["integrated", "measured"])
def test_unknown_stiction_is_within_its_part_of_the_level(
    believing, sine_motion, source: str
) -> None:
    """This arm's friction does not stick: what is taken to be held is an error, and covered."""
    chosen = {"stiction_share": 0.0, "unknown_side_share": 0.0, "motor_position": source}
    known, doubtful = believing(0.0, 0.0, **chosen), believing(0.0, 1.0, **chosen)
    ticks = slice(0, 1200)
    pairs = zip(sine_motion.replay(known, ticks), sine_motion.replay(doubtful, ticks), strict=True)
    most = np.zeros(7)
    for k, (one, other) in enumerate(pairs):
        error, above = np.abs(other.residual - one.residual), other.threshold - one.threshold
        if k > 3:  # before that there are no residuals
            assert np.all(error <= above + 1e-9), k
        most = np.maximum(most, error)
        np.testing.assert_array_equal(one.side, other.side)
    assert np.all(most > 0.2 * COULOMB)
    # In motion nothing of it is left.
    moving = np.abs(sine_motion.theta_dot[1199]) > 0.2
    assert moving.sum() > 2
    np.testing.assert_allclose(other.threshold[moving], CONTACT[moving], atol=1e-3)


def test_drift_of_the_motor_position_is_corrected(
    make_estimator, sine_motion, drifting_motion
) -> None:
    clean = sine_motion.replay(make_estimator(motor_position="measured"))
    estimates = drifting_motion.replay(make_estimator())
    assert np.all(worst(estimates) < 1.2 * worst(clean) + 0.05)
    loose = [0, 1, 3, 6]
    error = np.array([e.phi for e in estimates[500:]]) - drifting_motion.true_phi[500:]
    alpha = make_estimator().transmission.half_gap
    assert np.all(np.sqrt(np.mean(error**2, axis=0))[loose] < 0.25 * alpha[loose])
    raw = np.cumsum(drifting_motion.theta_dot * T, axis=0)
    drift = (drifting_motion.q - raw) - drifting_motion.true_phi
    assert np.all(np.abs(drift[-1] - drift[0])[loose] > 0.9 * 0.024)


def test_joints_reported_in_their_gaps_are_there(make_estimator, sine_motion) -> None:
    estimates = sine_motion.replay(make_estimator())
    side = np.array([e.side for e in estimates])
    alpha = make_estimator().transmission.half_gap
    inside = np.abs(sine_motion.true_phi) < 0.9 * alpha
    called = side == Side.GAP
    assert called[:, [1, 6]].sum() > 100
    # Half-gaps are wrong by a tenth; a tick late at either end of a passage is no harm.
    near = np.abs(sine_motion.true_phi) < 1.1 * alpha
    assert (called & ~near).sum() < 0.02 * called.sum()
    assert (called & inside)[:, [1, 6]].sum() > 0.5 * inside[:, [1, 6]].sum()


def test_the_correction_acts_while_engaged(make_transmission, romeo, sine_motion) -> None:
    # What a fit adds to tau_M is taken from the residual, through the same filter, except in gaps.
    def run(stiffness: float) -> list:
        loose = make_transmission().half_gap > 0
        transmission = make_transmission(contact_stiffness=stiffness * loose)
        levels = Thresholds(np.ones(7), np.full(7, 2.0))
        settings = EstimatorSettings(learning=False)
        estimator = Estimator(romeo, transmission, settings, levels, T)
        return sine_motion.replay(estimator, slice(0, 900))

    base, corrected = run(0.0), run(50.0)
    alpha = make_transmission().half_gap
    expected, apart = np.zeros(7), np.zeros(7, dtype=bool)
    for before, one, other in zip(corrected, base[1:], corrected[1:], strict=False):
        delta = one.phi - np.clip(one.phi, -alpha, alpha)
        apart = (one.side == Side.GAP) & (before.side == Side.GAP)
        if not other.flags:
            torque = np.where(apart, 0.0, 50.0 * delta)
            expected = ((2 - 25 * T) * expected - 2 * 25 * T * torque) / (2 + 25 * T)
        np.testing.assert_allclose(other.residual - one.residual, expected, atol=1e-9)
    assert np.abs(expected).max() > 0.02


@pytest.mark.parametrize("moved", [1.0, -1.0, 0.0])
@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize(("least", "most"), [(0.4, 0.4), (0.1, 0.7), (0.0, 1.0)])
def test_stiction_after_a_motion_is_half_known(
    believing, romeo, source: str, moved: float, least: float, most: float
) -> None:
    # All joints creep by 15 mrad and stand, not so abruptly that links would seem to swing back;
    # the drives bear gravity and all of the friction.
    estimator = believing(least, most, motor_position=source)
    t, settings = estimator.transmission, estimator.settings
    q = np.zeros(7)
    for k in range(300):
        speed = np.full(7, 0.05 * moved * (k >= 50) * 0.9 ** max(k - 70, 0))
        q = q + speed * T
        current = (romeo.gravity(q) + moved * t.engaged_coulomb) / t.torque_constant
        estimate = estimator.step(current, q, speed, q)
    # The middle is believed, and half of what is between may be off.
    expected = -moved * t.engaged_coulomb * (1.0 - 0.5 * (least + most))
    np.testing.assert_allclose(estimate.residual, expected, rtol=0.05, atol=0.001)
    raised = settings.stiction_share + (0.5 * (most - least) if moved else most)
    unsure = settings.unknown_side_share * CONTACT * (estimate.side == Side.UNKNOWN)
    level = CONTACT + unsure + raised * t.engaged_coulomb
    np.testing.assert_allclose(estimate.threshold, level, atol=1e-6)


# Contact


def test_twice_the_threshold_is_detected_in_motion(make_estimator, pushed_motion) -> None:
    estimator = make_estimator(beside=VARIANTS)
    estimates = pushed_motion.replay(estimator)
    at = 800
    assert not any(estimate.contacts for estimate in estimates[:at])
    first = {}
    for k, estimate in enumerate(estimates[at:]):
        for contact in estimate.contacts:
            assert contact.level == "contact"
            assert contact.torque > contact.threshold
            first.setdefault(contact.joint, k)
    assert set(first) == set(estimator.model.names)
    assert max(first.values()) * T < 0.12
    end = residuals(estimates[at + 50 :])
    external = pushed_motion.true_external[-1]
    assert np.all(np.abs(end.mean(axis=0) - external) < 0.3 * external)


def test_delay_of_a_push_is_ln2_over_gain_and_the_samples_delay(
    make_estimator, sine_motion
) -> None:
    # A torque step added to the motors' current is one that the links did not follow: exact.
    estimator, pushed = make_estimator(), make_estimator()
    step = 0.5 / estimator.transmission.torque_constant
    at = 900
    base = residuals(sine_motion.replay(estimator, slice(0, at + 40)))
    rows = zip(sine_motion.current, sine_motion.q, sine_motion.theta_dot, strict=True)
    moved = [
        pushed.step(current + step * (k > at), q, w, None, T)
        for k, (current, q, w) in zip(range(at + 40), rows, strict=False)
    ]
    rigid = 4  # no gap: the side cannot change
    response = (base - residuals(moved))[at:, rigid] / 0.5
    half = np.interp(0.5, response, np.arange(len(response)) * T)
    assert half == pytest.approx(np.log(2) / 25 + T / 2 + 0.002, abs=0.006)
    assert response[-1] == pytest.approx(1.0, abs=1e-3)


def test_linear_in_external_torque(make_estimator, sine_motion) -> None:
    def shifted(tau: np.ndarray) -> np.ndarray:
        estimator = make_estimator(residual=BARE, beside=())
        current = sine_motion.current - tau / estimator.transmission.torque_constant
        rows = zip(current[:300], sine_motion.q, sine_motion.theta_dot, strict=False)
        return residuals([estimator.step(*row, None, T) for row in rows])

    one, two = np.full(7, 0.3), np.array([1.0, -1, 0, 0, 2, 0, -2])
    base = shifted(np.zeros(7))
    both = shifted(2 * one + two) - base
    parts = 2 * (shifted(one) - base) + (shifted(two) - base)
    np.testing.assert_allclose(both, parts, atol=1e-10)
    np.testing.assert_allclose((shifted(two) - base)[-1], two, atol=1e-6)


# Estimates


def test_estimates_are_never_changed_afterwards(make_estimator, sine_motion) -> None:
    estimator = make_estimator()
    early = sine_motion.replay(estimator, slice(0, 200))[-1]
    names = ("q", "q_dot", "theta", "phi", "phi_sigma", "side", "tau_M", "residual", "thresholded")
    kept = {name: getattr(early, name).copy() for name in names}
    beside = early.beside["classical"].copy()
    sine_motion.replay(estimator, slice(200, 260))
    for name, values in kept.items():
        np.testing.assert_array_equal(getattr(early, name), values)
    np.testing.assert_array_equal(early.beside["classical"], beside)


# Parts that do not fit


def test_joints_in_any_order_give_the_same(
    make_estimator, make_transmission, sine_motion, romeo_urdf
) -> None:
    order = np.array([3, 0, 6, 1, 5, 2, 4])
    base = make_estimator()
    t = base.transmission
    names = [t.joints[i] for i in order]
    fields = ("torque_constant", "rotor_inertia", "half_gap", "motor_coulomb", "motor_viscous",
              "link_coulomb", "link_viscous")  # fmt: skip
    permuted = make_transmission(
        joints=names, **{field: getattr(t, field)[order] for field in fields}
    )
    levels = np.ones(7)
    other = Estimator(
        Model(romeo_urdf, names),
        permuted,
        EstimatorSettings(learning=False),
        Thresholds(levels, 2 * levels),
        T,
    )
    rows = (sine_motion.current, sine_motion.q, sine_motion.theta_dot)
    for row in zip(*(signal[:400] for signal in rows), strict=True):
        one = base.step(*row, None, T)
        two = other.step(*(values[order] for values in row), None, T)
        np.testing.assert_allclose(two.residual, one.residual[order], atol=1e-9)
        np.testing.assert_array_equal(two.side, one.side[order])


def test_parts_must_belong_together(make_estimator, make_transmission, romeo) -> None:
    levels = Thresholds(np.ones(7), np.full(7, 2.0))
    other = make_transmission(joints=(*romeo.names[:-1], "Elbow"))
    with pytest.raises(ModelError, match="transmission of"):
        Estimator(romeo, other, EstimatorSettings(), levels, T)
    with pytest.raises(ModelError, match="sign_width"):
        Estimator(romeo, make_transmission(), EstimatorSettings(sign_width=0.5), levels, T)
    with pytest.raises(ModelError, match="gain"):
        make_estimator(gain=200.0)
