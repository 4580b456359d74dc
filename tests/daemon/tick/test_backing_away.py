"""Arms of the population that back away: only from a hand, and from every hand."""

from dataclasses import replace

import pytest

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import alone, changes, world
from bench.study.changes import Change
from daemon.modes.contact_reactions import ContactReaction
from daemon.modes.table import Mode

LONGEST_S, FURTHEST_RAD = 0.3, 0.02
"""Motion without a person at work."""
AWAY_RAD = 0.05
PITCH, WRIST = 0, 4


def working(seed: int, change: Change, gears: world.Gears = "modelled") -> alone.Watched:
    """An arm that backs away, before it is armed and at work."""
    robot, law, _ = alone.arm_of(seed, ContactReaction.RETRACT)
    watched = alone.Watched(robot, law, seed, change)
    subject = replace(world.subject(robot, law, seed, gears), drift=0.0)
    watched.on = ArmInTheLoop(subject, robot, alone.START)
    watched.on.start()
    return watched


def moved(on: ArmInTheLoop, joint: int, torque: float, seconds: float) -> float:
    """Motion of the motor [rad] while a hand presses with the torque [Nm], in its direction."""
    begin = float(on.harness.plant.theta[joint])
    on.drives.external[joint] = torque
    on.run(seconds)
    on.drives.external[joint] = 0.0
    return (float(on.harness.plant.theta[joint]) - begin) * (1.0 if torque > 0.0 else -1.0)


@pytest.mark.parametrize(("seed", "joint", "factor"), [(2, 0, 2.5), (7, 1, 2.5), (1, 2, 3.0)])
def test_it_does_not_back_away_from_friction(seed: int, joint: int, factor: float) -> None:
    """It is interrupted, and stands until it is quiet."""
    watched = working(seed, Change("friction", joint, factor, 0.0))
    watched.run(20.0)
    changes.begin(watched.change, watched.on)
    watched.run(30.0)
    assert watched.seen.false
    assert watched.seen.alone_s <= LONGEST_S
    assert watched.seen.alone_rad <= FURTHEST_RAD


def test_it_stays_where_it_stopped_without_a_hand() -> None:
    """A spring below the stated level stops it, and its links coast through their gaps."""
    spring = Change("spring", 1, -0.3802741689783206, 0.0, 0.07628632058496188)
    watched = working(7028, spring, "ripple")
    watched.run(23.155)
    watched.there = True
    watched.run(20.0)
    assert watched.seen.alone_rad <= FURTHEST_RAD


def test_it_backs_away_from_a_hand_that_raised_the_level_first() -> None:
    on = working(3059, Change("load", PITCH, 0.0, 0.0), "load").on
    on.run(15.0)
    assert on.permit() == []
    level = on.robot.configuration.joints[PITCH].thresholds.contact
    moved(on, PITCH, -3.0 * level, 1.5)
    assert moved(on, PITCH, -6.0 * level, 1.0) > AWAY_RAD


def test_it_backs_away_from_a_hand_that_returns_and_continues_later() -> None:
    on = working(466231, Change("load", WRIST, 0.0, 0.0)).on
    on.run(15.0)
    assert on.permit() == []
    push = -6.0 * on.robot.configuration.joints[WRIST].thresholds.contact
    moved(on, WRIST, push, 0.5)
    on.run(1.0)
    assert moved(on, WRIST, push, 0.5) > AWAY_RAD
    on.run(6.0)
    assert on.mode is Mode.TRACKING
