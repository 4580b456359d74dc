"""The estimator's chain on one joint: (5) and (6), and the raise of its threshold.

All joints do the same: links move by `Q_DOT` and rotors by `THETA_DOT`, in gaps that are too wide
to be crossed meanwhile.
"""

from collections.abc import Callable

import numpy as np
import pytest

from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.interval import ROW
from estimator.model import Model
from estimator.motor_position import Side
from estimator.settings import EstimatorSettings, Variant
from estimator.thresholds import Thresholds

T = 0.01
WIDTH = 0.02
Q_DOT, THETA_DOT = 0.013, -0.021
PHI_DOT = Q_DOT - THETA_DOT
ONE = np.ones(7)
CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
PLAIN = {
    "half_gap": 0.05, "torque_constant": 2.0, "rotor_inertia": 0.0, "stiction": 0.0,
    "motor_coulomb": 1.0, "motor_viscous": 0.0, "link_coulomb": 0.0, "link_viscous": 0.0,
}  # fmt: skip


@pytest.fixture
def built(romeo: Model, make_transmission) -> Callable[..., Estimator]:
    def build(parameters: dict | None = None, **settings: object) -> Estimator:
        transmission = make_transmission(**(PLAIN | (parameters or {})))
        levels = Thresholds(CONTACT, 6 * CONTACT)
        return Estimator(romeo, transmission, EstimatorSettings(**settings), levels, T)

    return build


def moving(estimator: Estimator, load: float, ticks: int = 110) -> Estimate:
    """Lean on the lower border, then go; `load` is what the motor gives beyond its friction."""
    rub = np.tanh(THETA_DOT / WIDTH)
    for _ in range(20):
        estimator.step(5.0 * ONE, 0.1 * ONE, 0.0 * ONE, 0.0 * ONE)
    for k in range(ticks):
        current = 0.5 * (rub + load) * ONE
        estimate = estimator.step(
            current, (0.1 + Q_DOT * T * k) * ONE, THETA_DOT * ONE, THETA_DOT * T * k * ONE
        )
    return estimate


def sign(velocity: float) -> float:
    return float(np.tanh(velocity / WIDTH))


# (6): friction while engaged and in the gap, for a parameter that is 0.1 more.
RUBS = {
    "motor_coulomb": (sign(THETA_DOT), 0.0, sign(THETA_DOT)),
    "motor_viscous": (THETA_DOT, 0.0, THETA_DOT),
    "link_coulomb": (sign(THETA_DOT), sign(Q_DOT), sign(Q_DOT)),
    "link_viscous": (THETA_DOT, Q_DOT, Q_DOT),
    "gap_coulomb": (0.0, sign(PHI_DOT), 0.0),
    "gap_viscous": (0.0, PHI_DOT, 0.0),
}


@pytest.mark.parametrize("parameter", RUBS)
@pytest.mark.parametrize(
    ("kind", "load", "state", "row"),
    [
        ("backlash", 5.0, Side.LEFT, 0),
        ("backlash", 0.0, Side.GAP, 1),
        ("classical", 0.0, Side.GAP, 0),
        ("two_mass", 5.0, Side.LEFT, 2),
        ("two_mass", 0.0, Side.GAP, 2),
    ],
)
def test_each_friction_rubs_at_its_own_velocity(
    built, parameter: str, kind: str, load: float, state: Side, row: int
) -> None:
    more = PLAIN.get(parameter, 0.0) + 0.1
    settings = {"residual": Variant(kind=kind), "beside": (), "motor_position": "measured"}
    one = moving(built(**settings), load)
    other = moving(built({parameter: more}, **settings), load)
    np.testing.assert_array_equal(one.side, state)
    np.testing.assert_array_equal(other.side, state)
    # What rubs more is what the arm does not explain by itself, once the filter has settled.
    expected = 0.1 * RUBS[parameter][row]
    np.testing.assert_allclose(other.residual - one.residual, expected, atol=2e-6)


def test_each_signal_has_its_own_delay(built) -> None:
    # All of them grow by one per second; each arrives late by what is configured.
    estimator = built(
        current_delay_ms=3.0, link_position_delay_ms=1.0, motor_velocity_delay_ms=2.0,
        motor_position_delay_ms=0.5, motor_position="measured",
    )  # fmt: skip
    for k in range(5):
        t = T * k
        current, link = (t - 0.003) * ONE, (t - 0.001) * ONE
        estimate = estimator.step(current, link, (t - 0.002) * ONE, (t - 0.0005) * ONE)
    assert estimator.delay_s == pytest.approx(T / 2 + 0.001)
    instant = 4 * T - estimator.delay_s
    np.testing.assert_allclose(estimate.q, instant, atol=1e-12)
    np.testing.assert_allclose(estimate.tau_M / PLAIN["torque_constant"], instant, atol=1e-12)
    ends = estimator.memory()["interval"]["begin"]
    for name in ("theta_dot", "theta"):
        np.testing.assert_allclose(ends[ROW[name]], instant, atol=1e-12)


# The threshold in force


def test_a_joint_that_moves_has_its_contact_level(built) -> None:
    # Nothing is known of its stiction's state but that it is no matter.
    estimator = built({"stiction": 0.4}, motor_position="measured")
    for k in range(200):
        q = 0.3 * T * k * ONE
        estimate = estimator.step(5.0 * ONE, q, 0.3 * ONE, q)
    np.testing.assert_array_equal(estimate.side, Side.LEFT)
    np.testing.assert_allclose(estimate.threshold, CONTACT, atol=1e-9)


@pytest.mark.parametrize("share", [0.25, 0.0, 1.0])
def test_thresholds_of_a_joint_whose_side_is_unknown_are_raised(built, share: float) -> None:
    loose = np.array([0.02, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])
    estimator = built({"half_gap": loose}, unknown_side_share=share, stiction_share=0.0)
    first = estimator.step(0.0 * ONE, 0.0 * ONE, 0.0 * ONE)
    np.testing.assert_allclose(first.threshold, CONTACT * (1.0 + share * (loose > 0.0)))
    # No torque that tells a side; then one that does, on the second joint.
    for _ in range(200):
        estimate = estimator.step(0.0 * ONE, 0.0 * ONE, 0.0 * ONE)
    np.testing.assert_array_equal(estimate.side == Side.UNKNOWN, loose > 0.0)
    raised = CONTACT * (1.0 + share * (loose > 0.0))
    np.testing.assert_allclose(estimate.threshold, raised, atol=1e-9)
    for _ in range(200):
        estimate = estimator.step(5.0 * (np.arange(7) == 1), 0.0 * ONE, 0.0 * ONE)
    assert estimate.side[1] == Side.LEFT
    raised[1] = CONTACT[1]
    np.testing.assert_allclose(estimate.threshold, raised, atol=1e-6)


def test_starting_anew_forgets_what_the_last_motion_left(built) -> None:
    estimator = built({"stiction": 0.4, "half_gap": 0.0}, motor_position="measured")

    def threshold(travel: float) -> np.ndarray:
        for k in range(200):
            q = travel * min(k, 50) / 50 * ONE
            speed = travel / (50 * T) * (k < 50) * ONE
            estimate = estimator.step(0.0 * ONE, q, speed, q)
        return estimate.threshold - CONTACT - estimator.settings.stiction_share

    np.testing.assert_allclose(threshold(0.0), 0.4, atol=1e-6)
    np.testing.assert_allclose(threshold(0.1), 0.0, atol=1e-6)
    np.testing.assert_allclose(threshold(0.0), 0.0, atol=1e-6)
    estimator.restart()
    np.testing.assert_allclose(threshold(0.0), 0.4, atol=1e-6)


@pytest.mark.parametrize(
    ("speed", "link_speed", "z"),
    [
        (0.007, 0.0, 1.0),  # the rotor alone, in its gap
        (0.002, 0.0, -1.0),  # a bias
        (0.002, 0.002, 1.0),  # both
        (0.002, -0.0001, -1.0),
        (0.002, 0.02, 1.0),  # the link alone, by a hand
    ],
)
def test_what_turns_the_friction_of_a_rotor_that_creeps(
    built, speed: float, link_speed: float, z: float
) -> None:
    estimator = built({"stiction": 0.4})
    q = 0.0
    for k in range(250):
        moved, w = (-0.1, -0.1) if k < 50 else (link_speed, speed)
        q += moved * T
        estimator.step(0.0 * ONE, q * ONE, w * ONE)
    ends = estimator.memory()["stiction"]["ends"]
    np.testing.assert_allclose(np.mean(ends, axis=0), z, atol=0.1)


@pytest.mark.parametrize("time_s", [None, 77.0])
def test_a_contact_says_when(built, time_s: float | None) -> None:
    # By default the sum of all intervals, those of samples that were not used included.
    estimator = built({"half_gap": 0.0})
    contacts = []
    for k in range(100):
        current = 5.0 * (k >= 60) * ONE
        if k == 30:
            current = np.nan * ONE
        dt = 1.2 * T if k == 20 else T
        estimate = estimator.step(current, 0.0 * ONE, 0.0 * ONE, dt=dt, time_s=time_s)
        contacts += [(k, c) for c in estimate.contacts if k >= 60]
    assert contacts
    for k, contact in contacts:
        expected = T * (k + 1.2) if time_s is None else time_s
        assert contact.time_s == pytest.approx(expected)
