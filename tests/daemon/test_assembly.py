"""From a configuration to the objects of one arm: what belongs to single joints gets to them."""

from dataclasses import replace as changed

import numpy as np
import pytest
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO
from daemon.assembly import build_motion, build_transmission, largest_coulomb
from daemon.config.load import load_robot
from daemon.modes.table import Mode

T = 0.01


@pytest.mark.parametrize(("mass_s", "expected_s"), [(None, 0.05), (0.0, 0.0), (0.4, 0.4)])
def test_the_virtual_mass_of_a_joint_replaces_that_of_all(
    mass_s: float | None, expected_s: float
) -> None:
    robot = load_robot(ROMEO)
    joints = list(robot.configuration.joints)
    joints[2] = replace(joints[2], virtual_mass_s=mass_s)
    c = replace(
        robot.configuration,
        joints=joints,
        admittance=replace(robot.configuration.admittance, virtual_mass_s=0.05),
    )
    motion = build_motion(changed(robot, configuration=c), links_trusted=True)
    # So light a push that no limit of velocity or acceleration changes what follows from it.
    push = np.full(len(joints), 1e-3)
    q = np.array([0.5 * (j.limits.lower + j.limits.upper) for j in joints])
    motion.step(Mode.ADMITTANCE, q, None, push, T)
    goal = np.array([j.admittance_gain for j in joints]) * push
    tau_s = np.full(len(joints), 0.05)
    tau_s[2] = expected_s
    np.testing.assert_allclose(motion.velocity, goal * T / (tau_s + T), rtol=1e-9)


def test_a_hand_exceeds_friction_of_the_largest_load_too() -> None:
    """Taken off without being there, friction per load would push as far as that."""
    c = load_robot(ROMEO).configuration
    current = np.array([joint.wiring.max_current_A for joint in c.joints])
    t = build_transmission(c)
    np.testing.assert_array_equal(largest_coulomb(t, current), t.engaged_coulomb)
    loaded = changed(t, load_friction=0.1, load_friction_error=0.02)
    more = largest_coulomb(loaded, current) - t.engaged_coulomb
    np.testing.assert_allclose(more, 0.12 * t.torque_constant * current)
