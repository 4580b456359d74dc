"""Forces detectable at the tool, against forces tried in all directions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from daemon.config.load import load_robot
from estimator.model import Model
from estimator.tool_force import UNDETECTED_N, tool_sense

DIRECTIONS = np.random.default_rng(0).normal(size=(20_000, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]


def tried(jacobian: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Force [N] in each direction at which one joint exceeds its level."""
    return 1.0 / np.abs(DIRECTIONS @ (jacobian / level)).max(axis=1)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 12))
def test_no_direction_has_a_smaller_or_larger_detectable_force(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, level = rng.normal(size=(3, n)), rng.uniform(0.1, 3.0, n)
    jacobian *= rng.uniform(size=n) < 0.9  # some joints have no lever
    sense = tool_sense(jacobian, level)
    if len(sense.undetected):
        return
    forces = tried(jacobian, level)
    assert sense.least <= forces.min() * (1 + 1e-9)
    assert sense.most >= forces.max() * (1 - 1e-9)
    # Each is just detected in its own direction.
    for force, along in ((sense.least, sense.least_along), (sense.most, sense.most_along)):
        assert np.linalg.norm(along) == pytest.approx(1.0)
        assert np.abs(force * along @ (jacobian / level)).max() == pytest.approx(1.0)


def test_two_levers_in_a_plane() -> None:
    """Levers of 0.5 m along x and 0.25 m along y, levels of 1 Nm: felt from 2 N along x; worst in
    the corner of 2 and 4 N; not along z."""
    jacobian = np.array([[0.5, 0.0], [0.0, 0.25], [0.0, 0.0]])
    sense = tool_sense(jacobian, np.ones(2))
    assert sense.least == pytest.approx(2.0)
    assert np.abs(sense.least_along) == pytest.approx([1.0, 0.0, 0.0])
    assert sense.most == pytest.approx(np.hypot(2.0, 4.0))
    assert np.abs(sense.undetected) == pytest.approx(np.array([[0.0, 0.0, 1.0]]))


@given(seed=st.integers(0, 10_000), n=st.integers(1, 8), idle=st.integers(1, 8))
def test_a_joint_without_torque_changes_nothing(seed: int, n: int, idle: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, level = rng.normal(size=(3, n + idle)), rng.uniform(0.1, 3.0, n + idle)
    level[n:] = np.inf
    sense, without = tool_sense(jacobian, level), tool_sense(jacobian[:, :n], level[:n])
    assert (sense.least, sense.most) == pytest.approx((without.least, without.most))
    assert len(sense.undetected) == len(without.undetected) == max(3 - n, 0)


def test_joints_that_feel_nothing_feel_no_force() -> None:
    sense = tool_sense(np.eye(3), np.full(3, np.inf))
    assert len(sense.undetected) == 3
    assert sense.least == sense.most == UNDETECTED_N


@pytest.mark.parametrize("lever", [0.0, 0.0009])
def test_no_lever_feels_nothing(lever: float) -> None:
    sense = tool_sense(np.array([[lever], [0.0], [0.0]]), np.ones(1))
    assert len(sense.undetected) == 3
    assert sense.least == sense.most == UNDETECTED_N


@given(
    jacobian=st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=96),
    level=st.floats(1e-9, 1e6),
    lost=st.integers(0, 2),
)
def test_it_always_answers(jacobian: list[float], level: float, lost: int) -> None:
    """Whatever the pose: the daemon asks between two ticks, and must not fall over it."""
    n = len(jacobian) // 3
    J = np.reshape(jacobian[: 3 * n], (3, n))
    J[lost] = J[(lost + 1) % 3] * (1 + 1e-12)
    sense = tool_sense(J, np.full(n, level))
    assert np.isfinite([sense.least, sense.most]).all()
    assert sense.least <= sense.most * (1 + 1e-6)


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM, SINGLE_JOINT])
def test_the_jacobian_is_that_of_the_tool(folder) -> None:
    """A force at the tool does the work of its torques at the joints."""
    robot = load_robot(folder)
    names = robot.configuration.joint_names
    model = Model(robot.urdf, names)
    q = np.linspace(-0.3, -0.05, model.n)
    # By gravity: a mass at the tool weighs on the joints what its weight does there. Half of
    # the last body's mass is put there, which moves no centre of mass and no lever.
    link = robot.urdf.rindex("<mass value=")
    value = robot.urdf[link:].split('"')[1]
    heavier = robot.urdf[:link] + robot.urdf[link:].replace(value, str(1.5 * float(value)), 1)
    weight = 9.81 * 0.5 * float(value)
    expected = Model(heavier, names).gravity(q) - model.gravity(q)
    assert model.tool_jacobian(q)[2] * weight == pytest.approx(expected, abs=1e-9)
    # What the caller orders otherwise comes in that order.
    turned = Model(robot.urdf, names[::-1]).tool_jacobian(q[::-1])
    assert turned[:, ::-1] == pytest.approx(model.tool_jacobian(q))


def test_a_frame_off_the_last_joint_is_the_tool() -> None:
    robot = load_robot(SINGLE_JOINT)
    tool = (
        '<link name="tool0"/><joint name="flange" type="fixed"><parent link="bar"/>'
        '<child link="tool0"/><origin xyz="0 0 -0.4" rpy="0 0 0"/></joint></robot>'
    )
    with_tool = Model(robot.urdf.replace("</robot>", tool), ["joint"])
    assert Model(robot.urdf, ["joint"]).tool == "the centre of mass of bar"
    assert with_tool.tool == "the origin of tool0"
    assert with_tool.tool_jacobian(np.zeros(1))[:, 0] == pytest.approx([-0.4, 0.0, 0.0])


def test_inertia_is_the_diagonal_of_the_mass_matrix() -> None:
    robot = load_robot(ROMEO)
    model = Model(robot.urdf, robot.configuration.joint_names)
    q, one = np.full(7, -0.3), np.eye(7)
    columns = [model.dynamics(q, unit)[0][i] for i, unit in enumerate(one)]
    assert model.inertia(q) == pytest.approx(columns)
    assert model.reach == pytest.approx(0.205 + 0.1823 + 2 * 0.07, abs=2e-3)
