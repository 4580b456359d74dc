"""Motor position in the gap: how it starts, drifts, and is corrected."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.motor_position import MotorPosition, Side
from estimator.settings import GapSettings
from estimator.transmission import Transmission
from tests.estimator.one_joint import ALPHA, Joint, T


@pytest.fixture
def joint() -> Joint:
    return Joint()


@pytest.mark.parametrize("torque", [0.0, 0.9, -0.9])
def test_a_torque_that_may_be_friction_shows_nothing(joint: Joint, torque: float) -> None:
    for _ in range(100):
        joint.step(torque=torque)
    assert joint.side == Side.UNKNOWN
    assert joint.sigma == ALPHA


@pytest.mark.parametrize(
    ("torque", "side", "phi"), [(2.0, Side.LEFT, -ALPHA), (-2.0, Side.RIGHT, ALPHA)]
)
def test_a_clear_torque_shows_the_side_after_some_ticks(
    joint: Joint, torque: float, side: Side, phi: float
) -> None:
    sides = []
    for _ in range(4):
        joint.step(torque=torque)
        sides.append(joint.side)
    assert sides == [Side.UNKNOWN, Side.UNKNOWN, side, side]
    assert joint.phi == pytest.approx(phi)
    assert joint.sigma < 0.1 * ALPHA


def test_a_torque_that_changes_its_sign_is_not_held(joint: Joint) -> None:
    for k in range(50):
        joint.step(torque=2.0 if k % 4 < 2 else -2.0)
    assert joint.side == Side.UNKNOWN


@pytest.mark.parametrize(("torque", "sigma"), [(2.0, 0.0034), (8.0, 0.0094)])
def test_a_border_is_as_uncertain_as_the_gap_and_the_gear(torque: float, sigma: float) -> None:
    # Half-gap known to 7 %; the gear bends by up to 1 mrad per Nm.
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(torque)
    assert joint.sigma == pytest.approx(sigma, rel=0.01)


def test_theta_is_held_at_standstill(joint: Joint) -> None:
    joint.settle(2.0)
    theta = np.array(joint.position.theta)
    for _ in range(10_000):
        joint.step(w=-0.0015)
    np.testing.assert_array_equal(joint.position.theta, theta)


@pytest.mark.parametrize("bias", [0.02, -0.02])
def test_phi_never_leaves_the_gap_by_drift(joint: Joint, bias: float) -> None:
    for k in range(3000):
        joint.step(w=bias, torque=0.05)
        assert abs(joint.phi) <= ALPHA + 1e-12, k


def test_drift_at_an_engaged_border_is_pulled_out_a_little_at_a_time(joint: Joint) -> None:
    joint.settle(2.0)
    joint.position.theta[0] -= 0.5 * ALPHA
    errors = []
    for _ in range(30):
        joint.step(torque=2.0)
        errors.append(abs(joint.phi + ALPHA))
    steps = -np.diff([0.5 * ALPHA, *errors])
    assert np.all(steps >= 0)
    assert steps.max() <= 0.11 * ALPHA
    assert errors[-1] < 0.001 * ALPHA


def test_a_load_may_bend_the_gear() -> None:
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(3.0)
    joint.position.theta[0] = ALPHA + 0.002  # phi beyond the border by less than 3 Nm / stiffness
    for _ in range(20):
        joint.step(torque=3.0)
    assert joint.phi == pytest.approx(-ALPHA - 0.002)
    joint.position.theta[0] = ALPHA + 0.01
    for _ in range(60):
        joint.step(torque=3.0)
    assert joint.phi == pytest.approx(-ALPHA - 0.003, abs=1e-6)


def test_a_hand_that_moves_the_link_across_is_seen_not_explained_away(joint: Joint) -> None:
    # The rotor stands; the link is moved from one border to the other, then loads it.
    joint.settle(2.0)
    theta = float(joint.position.theta[0])
    for k in range(20):
        joint.step(q=0.002 * (k + 1), q_dot=0.2)
        assert joint.position.theta[0] == pytest.approx(theta, abs=1e-12)
    assert 0.04 - theta == pytest.approx(ALPHA)
    for _ in range(3):
        joint.step(q=0.04, torque=-2.0)
    assert joint.side == Side.RIGHT


def test_a_measured_position_does_not_become_less_certain() -> None:
    joint = Joint(measured=True)
    joint.settle(2.0)
    before = joint.sigma
    for k in range(1000):
        joint.step(w=0.1 if k % 20 < 10 else -0.1)
    assert joint.sigma == before


def test_a_joint_without_gap_is_always_engaged(joint: Joint) -> None:
    torques = [(0.01, Side.LEFT), (-0.01, Side.RIGHT), *[(3.0, Side.LEFT)] * 9]
    for k, (torque, side) in enumerate(torques):
        q = 0.7 + 0.1 * (-1) ** k
        joint.step(q=q, w=0.3, torque=torque)
        assert joint.position.theta[1] == pytest.approx(q, abs=1e-12)
        assert joint.position.sigma[1] == 0.0
        assert joint.position.side[1] == side


VELOCITY = st.floats(-2.0, 2.0)
TORQUE = st.floats(-20.0, 20.0)


@given(
    ticks=st.lists(st.tuples(VELOCITY, VELOCITY, TORQUE, TORQUE), min_size=1, max_size=40),
    alpha=st.sampled_from([0.0, 0.003, 0.1]),
    compliance=st.sampled_from([0.0, 1e-3]),
    measured=st.booleans(),
)
def test_a_correction_never_goes_beyond_where_phi_can_be(
    ticks: list[tuple[float, float, float, float]], alpha: float, compliance: float, measured: bool
) -> None:
    settings = GapSettings(compliance=compliance)
    coulomb, viscous = 0.5, 0.1
    transmission = Transmission(
        joints=("joint",),
        torque_constant=np.ones(1),
        rotor_inertia=np.zeros(1),
        half_gap=np.full(1, alpha),
        motor_coulomb=np.full(1, coulomb),
        motor_viscous=np.full(1, viscous),
        link_coulomb=np.zeros(1),
        link_viscous=np.zeros(1),
    )
    joint = MotorPosition(transmission, settings, measured)
    q = 0.3
    joint.start(0, q)
    for q_dot, theta_dot, tau_M, transmitted in ticks:
        q += q_dot * T
        still = not measured and abs(theta_dot) <= 0.002 and abs(q_dot) <= 0.01
        uncorrected = joint.theta[0] + (0.0 if still else theta_dot * T)
        joint.step(
            0, dt=T, q=q, q_dot=q_dot, theta_dot=theta_dot, resting=0.0, tau_M=tau_M,
            advance=theta_dot * T, rotor=0.0, transmitted=transmitted,
        )  # fmt: skip
        bent = alpha + abs(transmitted) * (compliance if alpha else 0.0)
        engaged = abs(joint.streak[0]) >= 3
        low, high = -bent, bent
        if engaged:
            low, high = (-bent, -alpha) if transmitted > 0.0 else (alpha, bent)
        phi = q - uncorrected
        needed = phi - min(max(phi, low), high)
        done = joint.theta[0] - uncorrected
        assert abs(done) <= abs(needed) + 1e-12
        assert done * needed >= 0.0
        if not engaged:
            assert done == pytest.approx(needed, abs=1e-12)
        assert 0.0 <= joint.sigma[0] <= alpha
        # Never "in the gap" while the gear carries more than can be friction.
        doubtful = settings.friction_error * (coulomb + viscous * abs(theta_dot))
        doubtful += settings.current_error * abs(tau_M)
        assert not (joint.gap[0] and abs(transmitted) > doubtful)


@pytest.mark.parametrize(
    ("phi", "speed", "ticks", "contradicted"),
    [
        (0.0, 0.3, 20, True),  # 60 mrad together, the gap is 40 wide
        (0.0, 0.3, 10, False),
        (0.0, 0.005, 60, False),
        (ALPHA, 0.3, 20, False),  # engaged
    ],
)
def test_a_link_that_follows_its_rotor_is_not_in_its_gap(
    joint: Joint, phi: float, speed: float, ticks: int, contradicted: bool
) -> None:
    joint.settle(-2.0 if phi > 0.0 else 2.0)
    joint.set(phi)
    q = 0.0
    for _ in range(ticks):
        q += speed * T
        joint.step(q=q, q_dot=speed, w=speed)
    assert joint.position.contradicted(0, speed) is contradicted
