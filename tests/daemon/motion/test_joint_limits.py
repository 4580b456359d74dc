"""Joint limits under a strong hand that pushes every joint into its limit at once, in lockstep."""

from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode

# What the drive's velocity loop and the gear give way under the hand, beside the commanded motion.
MARGIN_RAD = 0.004
AWAY_RAD = 0.35
WRIST = 5


def yielding(c: Configuration) -> Configuration:
    """As soft and as fast as the joints may be."""
    joints = [msgspec.structs.replace(joint, admittance_gain=5.0) for joint in c.joints]
    bounds = msgspec.structs.replace(c.admittance, velocity=2.0, max_excursion=6.0)
    return msgspec.structs.replace(c, joints=joints, admittance=bounds)


@pytest.fixture(params=[1.0, -1.0], ids=["upper", "lower"])
def pushed(request: pytest.FixtureRequest) -> Iterator[tuple[Rig, float]]:
    """Every joint AWAY_RAD before its limit, armed, and pushed with 0.4 of what its drive has."""
    sign = request.param
    with lockstep_rig(configure=yielding) as rig:
        limits = [joint.limits for joint in rig.robot.configuration.joints]
        border = np.array([limit.upper if sign > 0 else limit.lower for limit in limits])
        rig.arm.plant.place(border - sign * AWAY_RAD)
        rig.enable()
        rig.run(0.2)
        assert rig.permit("the test") == []
        joints = rig.robot.configuration.joints
        strength = np.array([0.4 * j.torque_constant * j.wiring.max_current_A for j in joints])
        felt = np.array([1.75 * j.thresholds.contact for j in joints])
        rig.arm.external_torque[:] = sign * np.maximum(strength, felt)
        yield rig, sign


def test_a_strong_hand_gets_no_joint_past_its_limit(pushed: tuple[Rig, float]) -> None:
    rig, sign = pushed
    joints = rig.robot.configuration.joints
    border = np.array([j.limits.upper if sign > 0 else j.limits.lower for j in joints])
    fastest = np.zeros(len(joints))
    furthest = np.full(len(joints), -np.inf)
    for _ in range(160):
        rig.step()
        decision, samples = rig.decision, rig.samples
        fastest = np.maximum(fastest, sign * decision.velocity)
        furthest = np.maximum(furthest, sign * (rig.arm.plant.q - border))
        beyond = sign * (samples.link_position - border) >= 0.0
        assert not (sign * decision.velocity[beyond] > 0.0).any()
        assert rig.mode is Mode.ADMITTANCE or rig.ticks < 100
    assert (fastest > 0.3).all()  # it was pushed, and came in speed
    assert (furthest < MARGIN_RAD).all()
    # And it stands there, at the limit and not somewhere before.
    assert (np.abs(rig.arm.plant.q - border) < 0.03).all()
    assert (furthest > -0.01).all()


# A half-gap that is wrong by 5 %, and a phi that is not known any better [rad].
REACH_RAD = 0.003


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["upper", "lower"])
def test_no_link_can_fall_through_its_gap_past_a_limit(sign: float) -> None:
    """Not even where the motor pushes the link there from behind."""
    with lockstep_rig() as rig:
        joints, plant = rig.robot.configuration.joints, rig.arm.plant
        border = np.array([j.limits.upper if sign > 0 else j.limits.lower for j in joints])
        plant.place(border - sign * 0.1)
        rig.enable()
        rig.tick.controller.motion.reference[:] = border
        furthest = np.full(len(joints), -np.inf)
        for _ in range(150):
            rig.step()
            # Where the link could be, if a person pushed it while the motor stands.
            furthest = np.maximum(
                furthest, sign * (plant.theta - border) + plant.parameters.half_gap
            )
        assert (furthest < REACH_RAD).all(), furthest
        assert (furthest > -0.01).all(), furthest  # and it was at the limit


UPPER = 0.3  # of LWristYaw, well inside its end stop


@contextmanager
def standing(beyond: float, end: str) -> Iterator[Rig]:
    """Off, LWristYaw so far beyond its upper limit; every joint ends like that."""

    def change(c: Configuration) -> Configuration:
        joints = [msgspec.structs.replace(joint, end=end) for joint in c.joints]
        limits = msgspec.structs.replace(joints[WRIST].limits, upper=UPPER)
        joints[WRIST] = msgspec.structs.replace(joints[WRIST], limits=limits)
        return msgspec.structs.replace(c, joints=joints)

    with lockstep_rig(configure=change) as rig:
        pose = rig.arm.plant.q.copy()
        pose[WRIST] = UPPER + beyond
        rig.arm.plant.place(pose)
        rig.run(0.02)
        yield rig


@pytest.mark.parametrize("end", ["brake", "hold"])
def test_an_arm_that_was_pressed_beyond_a_limit_comes_back_by_itself(end: str) -> None:
    """A fault may leave it there, where its brakes, or its drives, let no one move it by hand."""
    with standing(0.045, end) as rig:
        fastest: list[float] = []
        rig.run(0.1)
        rig.request(Event.ENABLE)
        rig.run(0.6, lambda: fastest.append(abs(rig.arm.plant.q_dot[WRIST])))
        assert rig.mode is Mode.HOLDING
        assert rig.arm.plant.q[WRIST] < UPPER + 0.002
        # The position loop's own speed at that distance: a person may stand beside.
        assert max(fastest) < 1.2 * 0.045 * rig.robot.configuration.control.position_gain
        assert rig.permit("the test") == []


@pytest.mark.parametrize(
    ("end", "how"),
    [
        ("limp", "move it back by hand"),
        ("brake", "release its brake and move it back by hand"),
        ("hold", "switch its drive off and move it back by hand"),
    ],
)
def test_further_out_a_person_has_to_move_it_and_the_refusal_says_how(end: str, how: str) -> None:
    with standing(0.07, end) as rig:
        (reason,) = rig.tick.controller.request(Event.ENABLE, "the test", rig.time_s)
        assert reason.endswith(f" rad, more than 0.05 outside its limits [-0.4, 0.3]: {how}")
        (check,) = [check for check in rig.arming.run(rig.time_s).checks if check.name == "limits"]
        assert not check.passed
