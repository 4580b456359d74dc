"""Forces detected over all poses, in `contactd check`."""

import re

import msgspec
import pytest

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from daemon.config.load import load_robot
from programs.contactctl.sensitivity_poses import sensitivity_over_poses


def test_a_bar_has_the_same_sensitivity_in_every_pose() -> None:
    """A level of 0.5 Nm, a quarter more while the side is unknown, at 0.2 m. In motion friction may
    be off by half; at rest all of it may hide something, and 0.9 of it comes to that."""
    robot = load_robot(SINGLE_JOINT)
    head, moving, resting = sensitivity_over_poses(robot.configuration, robot.model)
    assert head.startswith("smallest touch just after switching on, at the centre of mass of bar,")
    (joint,) = robot.configuration.joints
    friction = 0.33 + (joint.friction.motor_viscous + 0.02) * joint.limits.velocity
    least = (0.625 + 0.5 * friction) / 0.2
    nothing = "not detected in some direction in 100% of the poses"
    assert moving.startswith("  in motion  ")
    assert moving.endswith(f" N at best; {nothing}")
    assert [float(x) for x in re.findall(r"([\d.]+) (?:to|N)", moving)] == [
        pytest.approx(least, abs=0.06)
    ] * 2
    least = (0.625 + 1.9 * 0.33) / 0.2
    assert resting == f"  at rest    {least:.1f} to {least:.1f} N at best; {nothing}"


@pytest.mark.parametrize(("folder", "blind"), [(ROMEO, False), (DESK_ARM, True)])
def test_the_least_sensitive_direction_needs_more_force_than_the_most_sensitive(
    folder, blind: bool
) -> None:
    robot = load_robot(folder)
    for line in sensitivity_over_poses(robot.configuration, robot.model)[1:]:
        low, high, usual, rare = map(float, re.findall(r"([\d.]+) (?:to|N)", line))
        assert low <= high < usual < rare
        assert ("not detected" in line) == blind


def test_a_level_that_grows_with_speed_needs_more_force() -> None:
    robot = load_robot(SINGLE_JOINT)
    (joint,) = robot.configuration.joints
    levels = msgspec.structs.replace(joint.thresholds, per_speed=0.5)
    c = msgspec.structs.replace(
        robot.configuration, joints=[msgspec.structs.replace(joint, thresholds=levels)]
    )
    slow, fast = (sensitivity_over_poses(x, robot.model)[1] for x in (robot.configuration, c))
    by_speed = 0.5 * joint.limits.velocity / 0.2
    first, second = (float(re.findall(r"[\d.]+", line)[0]) for line in (slow, fast))
    assert second - first == pytest.approx(by_speed, abs=0.11)
