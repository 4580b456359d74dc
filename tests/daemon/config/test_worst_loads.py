"""Largest torque of gravity, against a pendulum's and against an optimiser's."""

import numpy as np
import pytest
from scipy.optimize import minimize

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from daemon.config.load import load_robot
from daemon.config.worst_loads import Load, worst_loads
from estimator.model import Model


def test_a_pendulum_at_its_limit():
    robot = load_robot(SINGLE_JOINT)
    (load,) = worst_loads(robot.configuration, robot.model)
    assert load.gravity == pytest.approx(1.0 * 9.81 * 0.2 * np.sin(1.4))
    assert load.motor == 3.0 * 4.0


def test_no_pose_asks_much_more():
    robot = load_robot(ROMEO)
    joints = robot.configuration.joints
    model = Model(robot.urdf, robot.configuration.joint_names)
    limits = [(joint.limits.lower, joint.limits.upper) for joint in joints]
    starts = np.random.default_rng(5).uniform(*np.transpose(limits), (300, 7))
    gravity = np.array([model.gravity(q) for q in starts])
    loads = worst_loads(robot.configuration, robot.model)
    for i in (0, 1, 6):
        most = 0.0
        for k in np.argsort(np.abs(gravity[:, i]))[-4:]:
            sign = np.sign(gravity[k, i])
            found = minimize(
                lambda q, i=i, s=sign: -s * model.gravity(q)[i], starts[k], bounds=limits
            )
            most = max(most, -found.fun)
        assert 0.98 * most < loads[i].gravity < 1.0001 * most


def test_always_the_same():
    robot = load_robot(ROMEO)
    once = worst_loads(robot.configuration, robot.model)
    assert worst_loads(robot.configuration, robot.model) == once


@pytest.mark.parametrize(("gravity", "too_much"), [(4.7, False), (4.8, False), (4.9, True)])
def test_a_load_that_the_motor_cannot_hold(gravity: float, too_much: bool):
    assert Load(gravity, motor=4.8).too_much is too_much
