"""Courses stay within what an arm may do, begin and end where they should, and are of all kinds."""

import numpy as np
import pytest

from bench.rigs.lockstep import DESK_ARM, ROMEO
from bench.study import courses
from bench.study.courses import PARTS, Room
from daemon.config.load import load_robot

CONFIGURATIONS = [load_robot(folder).configuration for folder in (ROMEO, DESK_ARM)]


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("c", CONFIGURATIONS, ids=lambda c: c.name)
def test_a_day_stays_within_limits_and_velocities(c, seed: int) -> None:
    course, kinds = courses.day(c, seed, 300.0)
    assert len(course.q) == len(course.velocity) == len(kinds) == 300 / c.period_s
    room = Room.of(c)
    assert (course.q >= room.lower - 1e-9).all()
    assert (course.q <= room.upper + 1e-9).all()
    assert (np.abs(course.velocity) <= room.fastest + 1e-9).all()
    assert set(kinds) == set(range(len(PARTS)))


@pytest.mark.parametrize("c", CONFIGURATIONS, ids=lambda c: c.name)
def test_its_velocity_is_that_of_its_positions(c) -> None:
    course, _ = courses.day(c, 3, 240.0)
    moved = np.diff(course.q, axis=0) / c.period_s
    between = 0.5 * (course.velocity[1:] + course.velocity[:-1])
    # Creeping joints reverse at once.
    assert np.abs(moved - between).max() < courses.CREEP + 0.01
    assert np.percentile(np.abs(moved - between), 99) < 0.002


def part(name: str, seconds: float = 20.0, seed: int = 5):
    room = Room.of(CONFIGURATIONS[0])
    rng = np.random.default_rng(seed)
    start = rng.uniform(room.lower, room.upper)
    return room, start, PARTS[name](room, start, seconds, rng)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_begins_where_the_arm_stands_and_ends_at_rest(name: str) -> None:
    room, start, course = part(name)
    step = (room.fastest * room.period_s).max()
    assert np.abs(course.q[0] - start).max() <= step
    assert np.abs(course.velocity[-1]).max() <= courses.CREEP + 1e-9
    assert len(course.q) >= 20.0 / room.period_s - 1


def test_creep_is_slow_and_goes_both_ways() -> None:
    _, _, course = part("creep", 60.0)
    assert set(np.unique(course.velocity)) == {-courses.CREEP, 0.0, courses.CREEP}


def test_reversals_are_of_one_joint_at_a_time() -> None:
    _, _, course = part("reversals", 60.0)
    moving = np.abs(course.velocity) > 1e-6
    assert moving.sum(axis=1).max() == 1
    assert moving.any(axis=0).sum() >= 3


def test_point_to_point_rests() -> None:
    _, _, course = part("point to point", 60.0)
    rests = (np.abs(course.velocity) < 1e-9).all(axis=1)
    assert 0.1 < rests.mean() < 0.9


def test_holding_holds() -> None:
    _, start, course = part("holding")
    assert (course.q == start).all()
    assert (course.velocity == 0.0).all()
