"""Figures of `bench.hand` against what the hand did."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from bench.study.evenness import POSES, Evenness, balanced_of, path_of
from bench.study.leading import Meter
from daemon.config.load import load_robot
from simulator.hand import Hand
from simulator.hand_script import Guide, Push, Release

NAMES = ("a", "b")


def meter(*script: object) -> tuple[Meter, SimpleNamespace]:
    arm = SimpleNamespace(plant=SimpleNamespace(q_dot=np.zeros(2)), now=0.0)
    return Meter(Hand(script, NAMES, np.full(2, 100.0)), arm), arm


def test_work_is_torque_times_way() -> None:
    hand, arm = meter(Push(at_s=0.1, joint="b", torque=-3.0, duration_s=1.0))
    arm.plant.q_dot[:] = 0.2, -0.5
    for ms in range(1500):
        hand.update(ms / 1000, np.zeros(2))
    led = hand.led(NAMES, 1, 1.0)
    assert led.peak_nm == led.usual_nm == 3.0
    assert led.work_j == pytest.approx(3.0 * 0.5, rel=2e-3)
    assert led.moved_rad == pytest.approx(-0.5, rel=2e-3)
    assert led.tremble == 0.0
    assert hand.led(NAMES, 0, 1.0).work_j == 0.0
    assert hand.done


def test_a_joint_that_shakes_trembles() -> None:
    script = (Guide(at_s=0.0, to={"a": 0.5}, speed=0.25), Release(at_s=2.0))
    hand, arm = meter(*script)
    q = np.zeros(2)
    for ms in range(2100):
        arm.plant.q_dot[0] = 0.25 * (1.0 + 0.5 * np.sin(2 * np.pi * ms / 100))
        q = q + 0.001 * arm.plant.q_dot
        hand.update(ms / 1000, q)
    assert hand.led(NAMES, 0, 2.0).tremble == pytest.approx(0.5 / np.sqrt(2), rel=1e-2)


def test_even_is_the_largest_force_of_the_smallest_over_all_poses_and_at_one() -> None:
    found = Evenness(led=np.array([[2.0, 4.0], [6.0, 5.0]]), peak=np.ones((2, 2)))
    assert found.ratio == pytest.approx(3.0)
    assert found.ratio_at_a_pose == pytest.approx(2.0)


def test_the_path_keeps_to_the_middle_of_every_range_and_comes_from_the_seed() -> None:
    c = load_robot(ROMEO).configuration
    path = path_of(c, 1)
    assert path.shape == (POSES, len(c.joints))
    lower, upper = (
        np.array([getattr(j.limits, end) for j in c.joints]) for end in ("lower", "upper")
    )
    margin = 0.2 * (upper - lower)
    assert (path >= lower + margin - 1e-12).all()
    assert (path <= upper - margin + 1e-12).all()
    np.testing.assert_array_equal(path, path_of(c, 1))
    assert (path != path_of(c, 2)).all()


def test_a_balanced_arm_differs_in_its_gains_alone() -> None:
    robot = load_robot(ROMEO)
    c = balanced_of(robot.configuration, robot.urdf)
    before = [j.admittance_gain for j in robot.configuration.joints]
    assert all(j.admittance_gain != k for j, k in zip(c.joints, before, strict=True))
    back = [
        msgspec.structs.replace(j, admittance_gain=k) for j, k in zip(c.joints, before, strict=True)
    ]
    assert msgspec.structs.replace(c, joints=back) == robot.configuration
