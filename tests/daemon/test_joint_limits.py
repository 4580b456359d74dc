"""A strong hand pushes every joint into its limit at once, in lockstep with the plant."""

from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from bench.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes import Mode

# What the drive's velocity loop and the gear give way under the hand, beside the commanded motion.
MARGIN_RAD = 0.004
AWAY_RAD = 0.35


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
        assert rig.cycle.controller.arm("the test") == []
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
        rig.tick()
        decision, samples = rig.cycle.decision, rig.cycle.samples
        assert decision is not None
        assert samples is not None
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
