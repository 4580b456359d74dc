"""Arms that age: a gap that doubles and friction that grows by 30 % within 30 days, on one joint.

Each day the arm is switched on, works, and is switched off: what was learned is gone, the day's
record stays. It warms up every day alike, at a temperature of the day that makes its friction up to
3 % more or less.
"""

from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from arrays import Matrix, Vector
from bench.rigs.arm_without_bus import Scenario, record
from bench.study import courses, world
from bench.study.estimates import build
from bench.study.loads import estimated
from bench.study.world import Law
from daemon.config.load import load_robot
from daemon.protocol.trend_row import HEAD, PER_JOINT, row_length
from daemon.trends.day import Day
from daemon.trends.findings import health
from daemon.trends.gather import Gatherer
from simulator.mismatch import PlantParameters

FIRST: Final = date(2026, 6, 1)
DAYS: Final = 30
GAP, FRICTION = 1.0, 0.3
"""more, after DAYS"""
AMBIENT: Final = 0.03
_TICKS: Final = 25  # between two looks at what was learned


@dataclass(frozen=True, slots=True)
class WearJob:
    """One arm; joint: that wears, -1 for none."""

    robot: Path
    law: Law
    seed: int
    joint: int
    days: int
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WearResult:
    """Joints that were named, with the day on which they were first."""

    job: WearJob
    named: dict[str, int]
    words: list[str]


def wear(job: WearJob) -> WearResult:
    """Simulate the days of one arm, and look at its health after each."""
    robot = load_robot(job.robot)
    names = robot.configuration.joint_names
    days: dict[str, Day] = {}
    named: dict[str, int] = {}
    words: list[str] = []
    gatherer = Gatherer("arm", names, robot.configuration.period_s, {})
    for k in range(job.days):
        gatherer.take(_rows(job, k), days)
        gatherer.end(days)
        for one in health([days[at] for at in sorted(days)]):
            if one.named and one.joint not in named:
                named[one.joint] = k + 1
                words.append(f"day {k + 1}: {one.joint}: {one.words}")
    return WearResult(job=job, named=named, words=words)


def _rows(job: WearJob, k: int) -> Matrix:
    """Rows of day k, as the daemon sends them."""
    robot = load_robot(job.robot)
    c, n = robot.configuration, len(robot.configuration.joints)
    ambient = np.random.default_rng((job.seed, k, 62)).uniform(1.0 - AMBIENT, 1.0 + AMBIENT)
    course, _ = courses.day(c, 1000 * job.seed + k, job.seconds)
    subject = replace(
        world.subject(robot, job.law, job.seed),
        aged=lambda arm: _aged(arm, job.joint, k / DAYS, ambient),
    )
    recording = record(subject, Scenario(seconds=job.seconds, motion=course))
    estimator = build(robot, beside=(), motor_position="measured")
    samples, ticks = recording.samples, len(recording.samples)
    rows = np.zeros((ticks, row_length(n)))
    rows[:, 0] = k * 10_000_000 + np.arange(ticks)
    noon = (FIRST + timedelta(days=k)).toordinal() - date(1970, 1, 1).toordinal()
    rows[:, 1] = 86400.0 * noon + 43200.0 + 0.01 * np.arange(ticks)
    joints = rows[:, HEAD:].reshape(ticks, n, PER_JOINT)
    joints[:, :, 0], joints[:, :, 1], joints[:, :, 2] = samples[:, 1], samples[:, 3], samples[:, 2]
    for begin in range(0, ticks, _TICKS):
        part = slice(begin, min(begin + _TICKS, ticks))
        found = estimated(estimator, recording, part)
        rows[part, 2] = ~found.thresholded.any(axis=1)
        joints[part, :, 3] = found.residual
        friction, joints[part, :, 5] = estimator.learned()
        joints[part, :, 4] = friction[0]
    return rows


def _aged(arm: PlantParameters, joint: int, age: float, ambient: float) -> PlantParameters:
    """The arm at an age of 0 ... 1; only `joint` wears."""
    n = len(arm.half_gap)
    worn = (np.arange(n) == joint) * age
    rubs: Vector = np.tile(ambient * (1.0 + FRICTION * worn), 2)
    return replace(
        arm,
        half_gap=arm.half_gap * (1.0 + GAP * worn),
        coulomb=arm.coulomb * rubs,
        viscous=arm.viscous * rubs,
    )
