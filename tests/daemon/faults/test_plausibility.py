"""Findings of implausible samples: each detector finds just beyond its bound, and not at it."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.plausibility import (
    GAP_TOLERANCE,
    OVERSPEED_TICKS,
    STUCK_TICKS,
    STUCK_TRAVEL,
    Plausibility,
    PlausibilitySettings,
)

T = 0.01
GAP, MARGIN, SPEED = 0.02, 0.05, 1.0  # half-gap, position margin, speed bound
PLAY = 2 * GAP_TOLERANCE * GAP + MARGIN
DRIFT, SCALE_ERROR = 0.001, 0.01
SATURATED_TICKS = 4
E = 1e-6
JOINTS = ("shoulder", "elbow")  # the elbow is disturbed


def bounds() -> PlausibilitySettings:
    return PlausibilitySettings(
        lower=np.array([-1.0, -1.0]),
        upper=np.array([2.0, 2.0]),
        speed=np.full(2, SPEED),
        half_gap=np.full(2, GAP),
        position_margin=MARGIN,
        current=np.full(2, 3.0),
        residual=np.full(2, 5.0),
        saturated_ticks=SATURATED_TICKS,
        motor_drift=DRIFT,
        motor_scale_error=SCALE_ERROR,
    )


class Joint:
    """The elbow of a two-jointed arm, tick by tick; the shoulder does nothing at all."""

    def __init__(self, *, measured: bool = True) -> None:
        self.plausibility = Plausibility(JOINTS, bounds())
        self.measured = measured
        self.q = self.theta = 0.0
        self.noise = 0

    def tick(
        self,
        q: float | None = None,
        *,
        theta: float | None = None,
        velocity: float = 0.0,
        current: float | None = None,
        residual: float = 0.0,
        dt: float = T,
        energised: bool = True,
    ) -> dict[Condition, str]:
        """Findings; encoder and current move on by a trifle unless they are given."""
        self.noise = 1 - self.noise
        self.q = self.q if q is None else q
        self.theta = self.theta if theta is None else theta
        trifle = 1e-9 * self.noise
        found = self.plausibility.step(
            np.array([0.0, self.q + (trifle if q is None else 0.0)]),
            np.array([0.0, velocity]),
            np.array([0.0, self.theta]) if self.measured else None,
            np.array([0.0, trifle if current is None else current]),
            np.array([0.0, residual]),
            np.array([T, dt]),
            energised,
        )
        assert all(finding.text == "elbow" for finding in found)
        return {finding.condition: finding.figures for finding in found}


@pytest.fixture
def joint() -> Joint:
    joint = Joint()
    assert joint.tick() == {}
    return joint


@pytest.fixture
def unmeasured() -> Joint:
    """Joint whose motor position is integrated from its velocity."""
    joint = Joint(measured=False)
    assert joint.tick() == {}
    return joint


@pytest.fixture(params=[1, -1])
def sign(request: pytest.FixtureRequest) -> int:
    return int(request.param)


def test_a_jump_against_the_motor(joint: Joint, sign: int) -> None:
    most = PLAY + SPEED * T
    assert Condition.JUMP not in joint.tick(sign * (most - E))
    found = joint.tick(-sign * 2 * E)
    assert found[Condition.JUMP] == f"by {most + E:.3f} rad, at most {most:.3f}"


def test_a_jump_is_measured_in_the_true_interval(joint: Joint) -> None:
    assert Condition.JUMP not in joint.tick(PLAY + 3 * SPEED * T - E, dt=3 * T)
    joint.plausibility.restart()
    joint.tick(0.0)
    assert Condition.JUMP in joint.tick(PLAY + 3 * SPEED * T - E, dt=T)


def test_a_link_that_goes_with_its_motor_does_not_jump(joint: Joint) -> None:
    assert joint.tick(0.5, theta=0.5) == {}
    assert Condition.JUMP in joint.tick(0.5, theta=0.0)


def test_a_jump_without_a_measured_motor_position(unmeasured: Joint) -> None:
    assert Condition.JUMP not in unmeasured.tick(0.5, velocity=0.5 / T)
    assert Condition.JUMP in unmeasured.tick(1.0)


def test_a_joint_that_is_moved_by_hand_may_be_fast(joint: Joint) -> None:
    found = joint.tick(0.5, theta=0.5, velocity=50.0, residual=9.0, current=3.0, energised=False)
    assert found == {}
    for _ in range(10):
        assert joint.tick(3.0, theta=3.0, velocity=50.0, current=3.0, energised=False) == {}
    # and nothing of that counts when it is energised
    assert joint.tick(1.0, theta=1.0, velocity=50.0, current=3.0) == {}


def test_apart_is_measured_over_the_whole_range_of_the_gap(joint: Joint) -> None:
    for q in (0.02, 0.04, 0.02, 0.0, -0.02, -(PLAY - 0.04) + E):
        assert joint.tick(q) == {}
    found = joint.tick(-(PLAY - 0.04) - E)
    assert found == {Condition.APART: f"by {PLAY:.3f} rad, at most {PLAY:.3f}"}
    assert Condition.APART in joint.tick(0.0), "until it is restarted"
    joint.plausibility.restart()
    assert joint.tick(0.0) == {}


def test_apart_is_found_while_the_drives_are_off(joint: Joint) -> None:
    for k in range(1, 10):
        found = joint.tick(0.011 * k, energised=False)
    assert set(found) == {Condition.APART}


@pytest.mark.parametrize(("share", "finds"), [(0.98, False), (1.02, True)])
def test_an_integrated_position_drifts(
    unmeasured: Joint, share: float, finds: bool, sign: int
) -> None:
    unmeasured.tick(sign * (PLAY - E))  # one extreme of the gap
    for _ in range(99):
        unmeasured.tick(sign * 0.5 * PLAY)
    # A second later it is known no better than this.
    found = unmeasured.tick(-sign * share * DRIFT * 1.0)
    assert (Condition.APART in found) is finds


@pytest.mark.parametrize(("share", "finds"), [(0.98, False), (1.02, True)])
def test_a_motor_that_turns_drifts_by_its_scale_error(
    unmeasured: Joint, share: float, finds: bool, sign: int
) -> None:
    unmeasured.tick(sign * (PLAY - E))
    unmeasured.tick(sign * 0.5 * PLAY)
    for _ in range(97):
        unmeasured.tick(unmeasured.q - 0.5 * T, velocity=-0.5)
    drift = 0.97 * 0.5 * SCALE_ERROR + 0.99 * DRIFT
    found = unmeasured.tick(-0.97 * 0.5 - sign * share * drift)
    assert (Condition.APART in found) is finds


def test_a_velocity_bias_of_a_standing_motor_is_not_integrated(unmeasured: Joint) -> None:
    for _ in range(1000):
        assert unmeasured.tick(0.0, velocity=0.02, current=0.0) == {}
    found = {c for _ in range(1000) for c in unmeasured.tick(0.0, velocity=0.021)}
    assert Condition.FROZEN in found


def test_a_frozen_encoder(joint: Joint, sign: int) -> None:
    most = PLAY - 0.5 * MARGIN
    joint.tick(0.0)
    found: dict[Condition, str] = {}
    for k in range(1, 100):
        if found := joint.tick(0.0, theta=sign * 0.001 * k):
            break
    turned = f"while the motor turned by {0.001 * k:.3f} rad, at most {most:.3f}"
    assert found == {Condition.FROZEN: turned}
    assert 0.001 * (k - 1) <= most < 0.001 * k
    joint.theta = 0.001 * (k - 1)
    joint.plausibility.restart()
    assert joint.tick(0.0) == {}


def test_an_encoder_that_moves_by_a_count_is_not_frozen(joint: Joint) -> None:
    for k in range(60):
        assert joint.tick(theta=0.001 * k) == {}


def test_a_frozen_encoder_is_not_found_for_a_motor_that_dithers(joint: Joint) -> None:
    for k in range(1000):
        assert joint.tick(0.0, theta=0.01 * (k % 2)) == {}


def test_a_stuck_current(joint: Joint) -> None:
    step = 1.02 * STUCK_TRAVEL / STUCK_TICKS
    for k in range(STUCK_TICKS):
        # The first of them is new.
        found = joint.tick(step * k, theta=step * k, current=0.7)
        assert found == {}
    found = joint.tick(step * (k + 1), theta=step * (k + 1), current=0.7)
    assert set(found) == {Condition.TORQUE_STUCK}
    assert found[Condition.TORQUE_STUCK].endswith(f"at most {STUCK_TRAVEL:.3f}")
    assert joint.tick(step * (k + 2), theta=step * (k + 2), current=0.8) == {}


def test_a_stuck_current_at_high_speed_is_found_after_its_ticks(joint: Joint) -> None:
    for k in range(STUCK_TICKS):
        assert joint.tick(0.02 * k, theta=0.02 * k, current=0.7) == {}
    assert set(joint.tick(0.4, theta=0.4, current=0.7)) == {Condition.TORQUE_STUCK}


def test_a_constant_current_at_rest_is_not_stuck(joint: Joint) -> None:
    for _ in range(3 * STUCK_TICKS):
        assert joint.tick(current=0.7) == {}


@pytest.mark.parametrize(
    ("condition", "ticks", "sample", "bound"),
    [
        (Condition.TORQUE_SATURATED, SATURATED_TICKS, "current", 0.95 * 3.0),
        (Condition.OVERSPEED, OVERSPEED_TICKS, "velocity", SPEED),
    ],
)
def test_a_bound_exceeded_for_consecutive_ticks(
    joint: Joint, sign: int, condition: Condition, ticks: int, sample: str, bound: float
) -> None:
    within, beyond = ({sample: sign * (bound + e)} for e in (-E, E))
    for _ in range(ticks - 1):
        assert joint.tick(**beyond) == {}
    assert joint.tick(**beyond) == {condition: f"for {ticks} ticks, at most {ticks - 1}"}
    assert joint.tick(**within) == {}
    assert joint.tick(**beyond) == {}, "counted anew"


def test_a_person_stronger_than_the_motor_is_no_overspeed(joint: Joint, sign: int) -> None:
    for _ in range(10):
        assert joint.tick(velocity=sign * 5.0, current=-sign * 1.51) == {}
    # It counts from when the motor no longer resists with half its current.
    found = [set(joint.tick(velocity=sign * 5.0, current=-sign * 1.49)) for _ in range(4)]
    assert {Condition.OVERSPEED} in found
    assert found[0] == set()


def test_a_residual_beyond_its_bound(joint: Joint, sign: int) -> None:
    assert joint.tick(residual=sign * 5.0) == {}
    assert joint.tick(residual=sign * 5.06) == {Condition.RESIDUAL_LIMIT: "5.1 Nm, at most 5.0"}


@pytest.mark.parametrize(("limit", "out"), [(2.0, 1), (-1.0, -1)])
def test_a_joint_that_goes_on_beyond_its_limit(joint: Joint, limit: float, out: int) -> None:
    edge = limit + out * MARGIN

    def at(where: float) -> set[Condition]:
        return set(joint.tick(where, theta=where))

    joint.plausibility.restart()
    at(edge - out * 0.002)
    assert at(edge - out * E) == set()
    assert at(edge + out * 0.001) == {Condition.JOINT_LIMIT}  # 0.1 rad/s outwards
    assert at(edge + out * 0.0011) == set(), "slower than what counts as standing"
    assert at(edge + out * 0.0005) == set(), "on its way back"
    found = joint.tick(edge + out * 0.002, theta=edge)
    text = f"at {edge + out * 0.002:.3f} rad; {-1.0 - MARGIN:.3f} to {2.0 + MARGIN:.3f} allowed"
    assert found == {Condition.JOINT_LIMIT: text}


def test_the_first_samples_are_accepted_whatever_they_are() -> None:
    joint = Joint()
    assert joint.tick(1.5, theta=-1.0, velocity=3.0, current=3.0) == {}
    assert joint.tick() == {}


def test_a_long_first_interval_allows_more_motion() -> None:
    joint = Joint()
    joint.tick(dt=1.0)
    assert Condition.JUMP not in joint.tick(PLAY + SPEED * 1.0 - E, dt=1.0)


def test_conditions_of_an_energised_arm_are_not_found_while_off(joint: Joint) -> None:
    for k in range(10):
        where = 2.1 + 0.01 * k
        found = joint.tick(where, theta=where, velocity=5.0, current=3.0, residual=9.0)
    assert set(found) == {
        Condition.OVERSPEED,
        Condition.TORQUE_SATURATED,
        Condition.RESIDUAL_LIMIT,
        Condition.JOINT_LIMIT,
    }
    for k in range(10, 30):
        where = 2.1 + 0.01 * k
        assert joint.tick(where, theta=where, velocity=5.0, current=3.0, energised=False) == {}


def test_each_joint_has_its_own_middle() -> None:
    wide = replace(bounds(), lower=np.array([-1.0, -1.0]), upper=np.array([3.0, 2.0]))
    plausibility = Plausibility(JOINTS, wide)
    nothing = np.zeros(2)
    for q, found in ((2.9, False), (3.04, False), (3.06, True)):
        at, current, gaps = np.array([q, 0.0]), np.full(2, 0.01 * q), np.full(2, T)
        findings = plausibility.step(at, nothing, at, current, nothing, gaps, True)
        assert findings == (Finding(Condition.JOINT_LIMIT, "shoulder"),) * found


def test_an_excused_finding_does_not_hide_another(joint: Joint) -> None:
    for k in range(8):  # a current that is stuck for too short a time, a motor that is overrun
        found = joint.tick(0.05 * k, theta=0.05 * k, velocity=5.0, current=-1.51, residual=9.0)
        assert set(found) == {Condition.RESIDUAL_LIMIT}
    joint.plausibility.restart()
    for k in range(5):
        found = joint.tick(2.2 - 0.001 * k, theta=2.2 + 0.04 * k)
    assert set(found) == {Condition.APART}, "on its way back"


def test_a_motor_braking_with_half_its_current_is_an_overspeed(joint: Joint, sign: int) -> None:
    for _ in range(OVERSPEED_TICKS):
        found = joint.tick(velocity=sign * 5.0, current=-sign * 1.5)
    assert set(found) == {Condition.OVERSPEED}


@pytest.mark.parametrize("off", [True, False])
def test_ticks_count_from_the_first_after_a_restart_or_while_off(joint: Joint, off: bool) -> None:
    if off:
        joint.tick(energised=False)
    else:
        joint.plausibility.restart()
    for _ in range(SATURATED_TICKS - 1):
        assert joint.tick(current=3.0) == {}
    assert set(joint.tick(current=3.0)) == {Condition.TORQUE_SATURATED}


def test_a_current_counts_as_stuck_from_the_first_energised_tick(joint: Joint) -> None:
    joint.tick(current=0.7, energised=False)
    for _ in range(2 * STUCK_TICKS):
        assert joint.tick(current=0.7) == {}
    for k in range(1, 12):
        found = joint.tick(0.01 * k, theta=0.01 * k, current=0.7)
    assert set(found) == {Condition.TORQUE_STUCK}


def test_the_first_samples_after_a_restart_are_accepted(joint: Joint) -> None:
    for _ in range(SATURATED_TICKS - 1):
        joint.tick(current=3.0, velocity=2.0)
    joint.plausibility.restart()
    assert joint.tick(1.5, theta=-1.0, current=3.0, velocity=2.0) == {}


def test_every_finding_is_named_with_its_joint_and_figures() -> None:
    plausibility = Plausibility(JOINTS, bounds())
    nothing, far = np.zeros(2), np.array([1.0, -1.5])
    plausibility.step(nothing, nothing, nothing, nothing, nothing, np.full(2, T), True)
    torques, gaps = np.array([9.0, 0.0]), np.full(2, T)
    found = plausibility.step(far, nothing, nothing, nothing, torques, gaps, True)
    play = f"at most {PLAY:.3f}"
    jump = f"at most {PLAY + SPEED * T:.3f}"
    # As text: figures do not count when findings are compared.
    assert [str(finding) for finding in found] == [
        f"encoder jump: shoulder (by 1.000 rad, {jump})",
        f"encoder jump: elbow (by 1.500 rad, {jump})",
        "residual implausible: shoulder (9.0 Nm, at most 5.0)",
        "beyond a joint limit: elbow (at -1.500 rad; -1.050 to 2.050 allowed)",
        f"motor and link apart: shoulder (by 1.000 rad, {play})",
        f"motor and link apart: elbow (by 1.500 rad, {play})",
    ]


def test_a_motor_that_creeps_under_a_hand_is_not_apart_from_its_link(unmeasured: Joint) -> None:
    """Slower than what is integrated, for a minute; a link that moves alone still is."""
    for k in range(6000):
        assert unmeasured.tick(0.0001 * k, velocity=0.01) == {}
    found = [unmeasured.tick(0.6 + 0.001 * k, velocity=0.01) for k in range(200)]
    assert Condition.APART in found[-1]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("what", ["theta", "velocity", "q", "current"])
@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize("after", [0, 3])
def test_a_sample_that_is_not_finite(bad: float, what: str, measured: bool, after: int) -> None:
    """As before the first frame that carries a motor position."""
    joint = Joint(measured=measured)
    for _ in range(after):
        joint.tick()
    joint.tick(**{what: bad})
    joint.q = joint.theta = 0.0
    for _ in range(3):
        assert joint.tick(0.0, theta=0.0) == {}
    assert Condition.JUMP in joint.tick(1.0)
    joint.plausibility.restart()
    found = [joint.tick(1.0, theta=0.02 * k, velocity=2.0) for k in range(40)]
    assert any(Condition.FROZEN in each for each in found)
