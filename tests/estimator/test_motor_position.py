"""Motor position in the gap: how it starts, drifts, is corrected, and when it says gap."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.motor_position import MOTION, GapSettings, JointGap, MotorPosition, Side
from estimator.transmission import Transmission, resting

T = 0.01
ALPHA = 0.02
COULOMB = 1.0
STIFF = GapSettings(compliance=0.0)


@dataclass
class Joint:
    """One joint with a gap of 0.02 rad beside a rigid one; moves as told, sees what is given."""

    settings: GapSettings = STIFF
    measured: bool = False
    position: MotorPosition = field(init=False)

    def __post_init__(self) -> None:
        transmission = Transmission(
            joints=("loose", "rigid"),
            torque_constant=np.ones(2),
            rotor_inertia=np.zeros(2),
            half_gap=np.array([ALPHA, 0.0]),
            motor_coulomb=np.full(2, COULOMB),
            motor_viscous=np.zeros(2),
            link_coulomb=np.zeros(2),
            link_viscous=np.zeros(2),
        )
        self.position = MotorPosition(transmission, self.settings, measured=self.measured)
        self.position.start(np.zeros(2))

    def step(
        self, *, q: float = 0.0, qd: float = 0.0, w: float = 0.0, torque: float = 0.0
    ) -> np.ndarray:
        motion = {
            "q": q, "q_dot": qd, "theta_dot": w, "resting": resting(np.array([w]))[0],
            "tau_M": torque, "advance": w * T, "rotor": 0.0, "transmitted": torque,
        }  # fmt: skip
        return self.position.step(np.array([[motion[name]] * 2 for name in MOTION]), T)

    @property
    def phi(self) -> float:
        return -float(self.position.theta[0])

    @property
    def side(self) -> Side:
        return Side(int(self.position.side[0]))

    @property
    def sigma(self) -> float:
        return float(self.position.sigma[0])

    def settle(self, torque: float) -> None:
        for _ in range(40):
            self.step(torque=torque)


@pytest.mark.parametrize("torque", [0.0, 0.9, -0.9])
def test_a_torque_that_may_be_friction_tells_nothing(torque: float) -> None:
    joint = Joint()
    for _ in range(100):
        joint.step(torque=torque)
    assert joint.side == Side.UNKNOWN
    assert joint.sigma == ALPHA


@pytest.mark.parametrize(
    ("torque", "side", "phi"), [(2.0, Side.LEFT, -ALPHA), (-2.0, Side.RIGHT, ALPHA)]
)
def test_a_clear_torque_tells_the_side_after_some_ticks(
    torque: float, side: Side, phi: float
) -> None:
    joint = Joint()
    sides = []
    for _ in range(4):
        joint.step(torque=torque)
        sides.append(joint.side)
    assert sides == [Side.UNKNOWN, Side.UNKNOWN, side, side]
    assert joint.phi == pytest.approx(phi)
    assert joint.sigma < 0.1 * ALPHA


def test_a_torque_that_changes_its_sign_is_not_held() -> None:
    joint = Joint()
    for k in range(50):
        joint.step(torque=2.0 if k % 4 < 2 else -2.0)
    assert joint.side == Side.UNKNOWN


def test_gap_only_when_clear_of_the_border_and_without_torque() -> None:
    joint = Joint()
    joint.settle(2.0)  # LEFT, theta = +alpha; the rotor then runs back through the gap
    seen = []
    for _ in range(40):
        joint.step(w=-0.1)
        seen.append((abs(joint.phi) / ALPHA, joint.side))
    assert joint.phi == pytest.approx(ALPHA)
    for phi, side in seen:
        assert (side == Side.GAP) == (phi < 1 - joint.settings.margin), phi
    assert {side for _, side in seen} == {Side.LEFT, Side.GAP, Side.RIGHT}


def test_an_interval_counts_as_gap_only_if_both_its_ends_are() -> None:
    joint = Joint()
    joint.settle(2.0)
    sides, engaged = [joint.side], []
    for _ in range(40):
        engaged.append(joint.step(w=-0.1)[0])
        sides.append(joint.side)
    both = [one == two == Side.GAP for one, two in pairwise(sides)]
    assert engaged == [0.0 if apart else 1.0 for apart in both]
    assert 5 < sum(both) < 35


@pytest.mark.parametrize(
    ("torque", "speed", "gap"),
    [
        (0.1, -0.1, True),
        (-0.1, -0.1, True),
        (0.4, -0.2, False),
        (0.9, -0.001, True),  # at rest, friction may hold it
        (1.4, -0.001, False),
    ],
)
def test_a_load_in_the_middle_of_the_gap_is_never_dropped(
    torque: float, speed: float, gap: bool
) -> None:
    joint = Joint()
    joint.settle(2.0)
    for _ in range(20):
        joint.step(w=-0.1)
    assert abs(joint.phi) < 0.1 * ALPHA
    joint.step(w=speed, torque=torque)
    assert (joint.side == Side.GAP) == gap


@pytest.mark.parametrize(("torque", "sigma"), [(2.0, 0.0034), (8.0, 0.0094)])
def test_a_border_is_as_uncertain_as_the_gap_and_the_gear(torque: float, sigma: float) -> None:
    # Half-gap known to 7 %; the gear bends by up to 1 mrad per Nm.
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(torque)
    assert joint.sigma == pytest.approx(sigma, rel=0.01)


def test_clear_of_the_border_by_more_than_what_phi_may_be_off() -> None:
    joint = Joint(GapSettings(compliance=0.001))
    joint.settle(8.0)
    said = []
    for _ in range(40):
        joint.step(w=-0.1)
        said.append((abs(joint.phi), joint.side == Side.GAP))
    assert {gap for _, gap in said} == {False, True}
    for phi, gap in said:
        assert gap == (phi < ALPHA - 1.5 * joint.sigma), phi


def test_no_gap_once_theta_is_as_uncertain_as_the_gap_is_wide() -> None:
    joint = Joint(GapSettings(velocity_bias=0.01))
    joint.settle(2.0)
    for _ in range(20):
        joint.step(w=-0.1)
    assert joint.side == Side.GAP
    growth = []
    for k in range(300):
        joint.step(w=0.003 if k % 2 else -0.003)
        growth.append(joint.sigma)
    assert joint.side == Side.UNKNOWN
    assert joint.sigma == ALPHA
    assert np.all(np.diff(growth) >= 0)


def test_theta_is_held_at_standstill() -> None:
    joint = Joint()
    joint.settle(2.0)
    theta = joint.position.theta
    for _ in range(10_000):
        joint.step(w=-0.0015)
    np.testing.assert_array_equal(joint.position.theta, theta)


@pytest.mark.parametrize("bias", [0.02, -0.02])
def test_phi_never_leaves_the_gap_by_drift(bias: float) -> None:
    joint = Joint()
    for k in range(3000):
        joint.step(w=bias, torque=0.05)
        assert abs(joint.phi) <= ALPHA + 1e-12, k


def test_drift_at_an_engaged_border_is_pulled_out_a_little_at_a_time() -> None:
    joint = Joint()
    joint.settle(2.0)
    joint.position.joints[0].theta -= 0.5 * ALPHA
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
    joint.position.joints[0].theta = (
        ALPHA + 0.002
    )  # phi beyond the border by less than 3 Nm / stiffness
    for _ in range(20):
        joint.step(torque=3.0)
    assert joint.phi == pytest.approx(-ALPHA - 0.002)
    joint.position.joints[0].theta = ALPHA + 0.01
    for _ in range(60):
        joint.step(torque=3.0)
    assert joint.phi == pytest.approx(-ALPHA - 0.003, abs=1e-6)


def test_a_hand_that_moves_the_link_across_is_seen_not_explained_away() -> None:
    # The rotor stands; the link is moved from one border to the other, then loads it.
    joint = Joint()
    joint.settle(2.0)
    theta = float(joint.position.theta[0])
    for k in range(20):
        joint.step(q=0.002 * (k + 1), qd=0.2)
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


def test_a_joint_without_gap_is_always_engaged() -> None:
    joint = Joint()
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
    joint = JointGap(
        GapSettings(compliance=compliance),
        alpha=alpha,
        coulomb=0.5,
        viscous=0.1,
        measured=measured,
    )
    q = 0.3
    joint.start(q)
    for q_dot, theta_dot, tau_M, transmitted in ticks:
        q += q_dot * T
        still = not measured and abs(theta_dot) <= 0.002 and abs(q_dot) <= 0.01
        uncorrected = joint.theta + (0.0 if still else theta_dot * T)
        joint.step(
            q=q, q_dot=q_dot, theta_dot=theta_dot, resting=0.0, tau_M=tau_M,
            advance=theta_dot * T, rotor=0.0, transmitted=transmitted, dt=T,
        )  # fmt: skip
        bent = alpha + abs(transmitted) * (compliance if alpha else 0.0)
        engaged = abs(joint.streak) >= 3
        low, high = -bent, bent
        if engaged:
            low, high = (-bent, -alpha) if transmitted > 0.0 else (alpha, bent)
        phi = q - uncorrected
        needed = phi - min(max(phi, low), high)
        done = joint.theta - uncorrected
        assert abs(done) <= abs(needed) + 1e-12
        assert done * needed >= 0.0
        if not engaged:
            assert done == pytest.approx(needed, abs=1e-12)
        assert 0.0 <= joint.sigma <= alpha
        # Never "in the gap" while the gear carries more than can be friction.
        doubtful = 0.2 * (0.5 + 0.1 * abs(theta_dot)) + 0.05 * abs(tau_M)
        assert not (joint.gap and abs(transmitted) > doubtful)
