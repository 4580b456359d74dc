"""Hands that pull straight down at arms at work, ever more steadily: what is taken for a load.

No hand keeps its force, but how little it changes differs. Each arm is pulled at once with every
steadiness, in an order of its own, for 39 s each.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin

from arrays import Matrix, Vector
from bench.rigs.arm_without_bus import Scenario, record
from bench.study import courses, world
from bench.study.estimates import build
from bench.study.loads import AWAY_M, FREE_S, HandJob, estimated
from daemon.config.load import Robot, load_robot
from estimator.model import Model
from estimator.recognition import Recognition

CHANGES: Final = (0.02, 0.04, 0.07, 0.10, 0.15)
"""of the force, root mean square"""
EACH_S: Final = 45.0
REST_S: Final = 3.0
"""without a hand, at the beginning and end of each"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyResult:
    """One pull at one arm: seconds from its beginning until it was taken for a load, and until that
    was confirmed; None: not while it lasted."""

    seed: int
    changes: float
    newtons: float
    found_s: float | None
    confirmed_s: float | None


def steady_hand(job: HandJob) -> list[SteadyResult]:
    """Simulate one arm, and judge each of its pulls."""
    robot = load_robot(job.robot)
    c = robot.configuration
    rng = np.random.default_rng((job.seed, 77))
    seconds = FREE_S + EACH_S * len(CHANGES)
    course, _ = courses.day(c, job.seed, seconds)
    torque = np.zeros_like(course.q)
    spans = []
    for k, which in enumerate(rng.permutation(len(CHANGES))):
        begin, end = (round(100 * (FREE_S + EACH_S * k + at)) for at in (REST_S, EACH_S - REST_S))
        newtons, force = _force(end - begin, CHANGES[which], rng)
        torque[begin:end] = _torque(robot, course.q[begin:end], force, rng)
        spans.append((begin, end, CHANGES[which], newtons))
    strength = np.array([j.torque_constant * j.wiring.max_current_A for j in c.joints])
    torque = np.clip(torque, -0.5 * strength, 0.5 * strength)
    scenario = Scenario(seconds=seconds, motion=course, torque=torque)
    recording = record(world.subject(robot, job.law, job.seed), scenario)
    rows = estimated(build(robot, beside=(), motor_position="integrated"), recording)
    recognition = Recognition(Model(robot.urdf, c.joint_names), c.period_s)
    found, confirmed = np.zeros((2, len(rows.q)), dtype=np.bool_)
    for tick in range(len(rows.q)):
        recognition.step(
            rows.q[tick], rows.q_dot[tick], rows.residual[tick], rows.threshold[tick],
            touched=bool(rows.thresholded[tick].any()),
        )  # fmt: skip
        found[tick], confirmed[tick] = recognition.found is not None, recognition.confirmed
    return [
        SteadyResult(
            seed=job.seed,
            changes=changes,
            newtons=newtons,
            found_s=_first(found[begin:end]),
            confirmed_s=_first(confirmed[begin:end]),
        )
        for begin, end, changes, newtons in spans
    ]


def _first(ticks: np.ndarray) -> float | None:
    return 0.01 * float(np.argmax(ticks)) if ticks.any() else None


def _force(ticks: int, changes: float, rng: np.random.Generator) -> tuple[float, Matrix]:
    """Mean force [N], and force tick by tick (ticks, 3) [N], almost straight down."""
    at = np.arange(ticks)
    comes = np.minimum(1.0, np.minimum(at, at[::-1]) / 30.0)
    waves = [np.sin(2 * np.pi * (rng.uniform(0.08, 0.8) * 0.01 * at + rng.random()))
             for _ in range(4)]  # fmt: skip
    wander: Vector = np.sum(waves, axis=0)
    size = float(rng.uniform(3.0, 12.0))
    way = np.array([0.0, 0.0, -1.0]) + 0.03 * rng.normal(size=3)
    along = size * comes * (1.0 + changes * wander / wander.std())
    return size, along[:, np.newaxis] * way / np.linalg.norm(way)


def _torque(robot: Robot, q: Matrix, force: Matrix, rng: np.random.Generator) -> Matrix:
    """Torque (ticks, n) [Nm] of forces near the tool, on an arm at q."""
    model = pin.buildModelFromXML(robot.urdf)
    data, n = model.createData(), model.nv
    lever = model.inertias[n].lever + rng.uniform(-AWAY_M, AWAY_M, 3)
    torque = np.zeros_like(q)
    for k in range(len(q)):
        if k % 5 == 0:
            pin.computeJointJacobians(model, data, q[k])
            J = pin.getJointJacobian(model, data, n, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = data.oMi[n].rotation @ lever
        torque[k] = J[:3].T @ force[k] + J[3:].T @ np.cross(arm, force[k])
    return torque
