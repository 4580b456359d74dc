"""Loads and hands on arms as wide as the world: simulated without a bus, estimated, and looked for.

load     two minutes with nothing, then a point mass in the hand; told, or not
hand     pushes, leads, leaning, and pulling straight down with a force that changes
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pinocchio as pin

from bench.rigs.arm_without_bus import Carried, Recording, Scenario, record
from bench.study import courses, world
from bench.study.estimates import build, rows_of
from bench.study.world import Law
from common.arrays import Matrix, Vector
from daemon.config.load import Robot, load_robot
from estimator.estimate import EstimateRows
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.payload import Payload
from estimator.recognition import Recognition

Touch = Literal["push", "lead", "lean", "pull"]
TOUCHES: Final[tuple[Touch, ...]] = ("push", "lead", "lean", "pull")
FREE_S: Final = 120.0
LOADED_S: Final = 90.0
AWAY_M: Final = 0.03  # place of a load from the tool point, along each axis, at most
MOVES: Final = 0.05
CARRIES_NM: Final = 0.1  # a joint that carries a load feels so much of it
WAY: Final = 0.5  # [rad]


@dataclass(frozen=True, slots=True)
class LoadJob:
    """One arm, and the masses that it gets, each by itself [kg]."""

    robot: Path
    law: Law
    seed: int
    masses: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadResult:
    """What became of one mass; times count the motion of joints that carry it, from then on."""

    job: LoadJob
    given: float  # [kg]
    enough: bool  # they moved for ten seconds, and WAY
    found_s: float | None  # None: not within the run
    seconds_s: float  # the same by the clock; NaN
    mass: float  # that was believed [kg]; NaN
    confirmed: float  # mass that was confirmed [kg]; NaN
    told_before: int  # loads that were recognised before there was one
    ratio: float
    """root mean square of r in motion over the configured levels: with the load told, over that of
    the same motion without it"""


def load(job: LoadJob) -> list[LoadResult]:
    """Simulate and judge one arm, a result for each mass."""
    robot = load_robot(job.robot)
    rng = np.random.default_rng((job.seed, 60))
    place = Model(robot.urdf, robot.configuration.joint_names).tool_place
    place = place + rng.uniform(-AWAY_M, AWAY_M, 3)
    free = _at_work(robot, job, 0.0, place)
    return [_judged(robot, job, free, Payload.of(mass, place.tolist())) for mass in job.masses]


def _judged(robot: Robot, job: LoadJob, free: Recording, payload: Payload) -> LoadResult:
    """The arm with one payload, beside what it does without."""
    c = robot.configuration
    model = Model(robot.urdf, c.joint_names)
    begin = round(FREE_S / c.period_s)
    loaded = _at_work(robot, job, payload.mass, np.array(payload.com))
    rows = rows_of(_estimator(robot), loaded.samples)
    found = recognised(model, rows, loaded)
    moved_s = _moved_s(model, payload, loaded, begin)
    after = [one for one in found if one.tick >= begin]
    tick, mass = (after[0].tick, after[0].mass) if after else (None, np.nan)
    confirmed = [one.confirmed for one in after if not np.isnan(one.confirmed)]
    return LoadResult(
        job=job,
        given=payload.mass,
        enough=bool(moved_s[-1] >= 10.0),
        found_s=None if tick is None else float(moved_s[tick - begin]),
        seconds_s=np.nan if tick is None else c.period_s * (tick - begin),
        mass=mass,
        confirmed=confirmed[0] if confirmed else np.nan,
        told_before=len(found) - len(after),
        ratio=_ratio(robot, free, loaded, payload, begin),
    )


def _at_work(robot: Robot, job: LoadJob, mass: float, place: Vector) -> Recording:
    course, _ = courses.day(robot.configuration, job.seed, FREE_S + LOADED_S)
    carried = (Carried(FREE_S, mass, place),) if mass else ()
    scenario = Scenario(seconds=FREE_S + LOADED_S, motion=course, carried=carried)
    return record(world.subject(robot, job.law, job.seed), scenario)


def _estimator(robot: Robot) -> Estimator:
    return build(robot, beside=(), motor_position="integrated")


@dataclass(slots=True)
class Recognised:
    """One load that was recognised: since which tick, its mass, and that which was confirmed later
    [kg], NaN if none was."""

    tick: int
    mass: float
    confirmed: float = np.nan


def recognised(model: Model, rows: EstimateRows, recording: Recording) -> list[Recognised]:
    """Loads that were recognised, in their order."""
    recognition = Recognition(model, float(recording.time_s[1] - recording.time_s[0]))
    found, before = list[Recognised](), None
    for tick in range(len(rows.q)):
        recognition.step(
            rows.q[tick], rows.q_dot[tick], rows.residual[tick], rows.threshold[tick],
            touched=bool(rows.thresholded[tick].any()),
        )  # fmt: skip
        now = recognition.found
        if now is not None and before is None:
            found.append(Recognised(tick, now.mass))
        if now is not None and recognition.confirmed:
            found[-1].confirmed = now.mass
        before = now
    return found


def _moved_s(model: Model, payload: Payload, recording: Recording, begin: int) -> Vector:
    """Seconds of motion of joints that carry it since `begin`, by tick; none before WAY."""
    q, speed = recording.samples[begin:, 1], np.abs(recording.samples[begin:, 2])
    carries = np.empty(q.shape, dtype=np.bool_)
    for tick in range(len(q)):
        if tick % 10 == 0:
            by_mass, by_place = model.payload_torques(q[tick], model.down)
            torque: np.ndarray = payload.mass * (by_mass + by_place @ np.array(payload.com))
        carries[tick] = np.abs(torque) > CARRIES_NM
    moves = carries & (speed > MOVES)
    way = np.cumsum(np.sum(moves * speed, axis=1)) * 0.01
    seconds = 0.01 * np.cumsum(moves.any(axis=1))
    return np.where(way > WAY, seconds, np.minimum(seconds, 9.99))


def _ratio(robot: Robot, free: Recording, loaded: Recording, payload: Payload, begin: int) -> float:
    contact = np.array([joint.thresholds.contact for joint in robot.configuration.joints])
    sizes = []
    for recording, told in ((free, None), (loaded, payload)):
        estimator = _estimator(robot)
        rows_of(estimator, recording.samples[:begin])
        estimator.carry(told)
        # The pick-up itself, and what the new model makes of it, take a moment.
        rows = rows_of(estimator, recording.samples[begin:])
        moving = np.abs(recording.samples[begin + 200 :, 2]) > MOVES
        size = np.where(moving, rows.residual[200:] / contact, np.nan)
        sizes.append(float(np.sqrt(np.nanmean(size**2))))
    return sizes[1] / sizes[0]


@dataclass(frozen=True, slots=True)
class HandJob:
    """One arm that hands touch."""

    robot: Path
    law: Law
    seed: int
    touch: Touch
    seconds: float


def hand(job: HandJob) -> tuple[HandJob, list[Recognised]]:
    """Loads that were recognised while hands touched the arm."""
    robot = load_robot(job.robot)
    c = robot.configuration
    course, _ = courses.day(c, job.seed, FREE_S + job.seconds)
    begin = round(FREE_S / c.period_s)
    torque = np.zeros_like(course.q)
    rng = np.random.default_rng((job.seed, 61))
    torque[begin:] = hand_torque(robot, course.q[begin:], job.touch, rng)
    strength = np.array([j.torque_constant * j.wiring.max_current_A for j in c.joints])
    scenario = Scenario(
        seconds=FREE_S + job.seconds,
        motion=course,
        torque=np.clip(torque, -0.5 * strength, 0.5 * strength),
    )
    recording = record(world.subject(robot, job.law, job.seed), scenario)
    model = Model(robot.urdf, c.joint_names)
    return job, recognised(model, rows_of(_estimator(robot), recording.samples), recording)


def hand_torque(robot: Robot, q: Matrix, touch: Touch, rng: np.random.Generator) -> Matrix:
    """Torque of hands, one after the other, on an arm at q (ticks, n) [rad]; 100 ticks a second."""
    model = pin.buildModelFromXML(robot.urdf)
    data, n = model.createData(), model.nv
    torque, t = np.zeros_like(q), 0
    while t < len(q) - 100:
        t += int(rng.uniform(100, 500))
        length = int(rng.uniform(30, 300) if touch == "push" else rng.uniform(1000, 4000))
        end = min(t + length, len(q))
        if end <= t:
            break
        link = int(rng.integers(2, n)) if touch == "lean" else n - 1
        lever = model.inertias[link + 1].lever + rng.uniform(-0.04, 0.04, 3)
        force = _force(touch, end - t, rng)
        for k in range(t, end):
            if (k - t) % 5 == 0:
                pin.computeJointJacobians(model, data, q[k])
                axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                J = pin.getJointJacobian(model, data, link + 1, axes)
                arm = data.oMi[link + 1].rotation @ lever
            torque[k] = J[:3].T @ force[k - t] + J[3:].T @ np.cross(arm, force[k - t])
        t = end
    return torque


def _force(touch: Touch, ticks: int, rng: np.random.Generator) -> Matrix:
    """Force of one hand (ticks, 3) [N], which comes and goes within half a second at most."""
    at = np.arange(ticks)
    comes = np.minimum(1.0, np.minimum(at, at[::-1]) / rng.uniform(5.0, 50.0))
    size, way = rng.uniform(2.0, 20.0), rng.normal(size=3)
    if touch == "lead":
        return np.stack([size * comes * _wander(ticks, 0.4, rng) for _ in range(3)], axis=1)
    if touch == "pull":
        way = np.array([0.0, 0.0, -1.0]) + 0.05 * way
    depth = {"push": 0.0, "lean": rng.uniform(0.05, 0.3)}.get(touch, rng.uniform(0.25, 0.8))
    changes = np.maximum(1.0 + depth * _wander(ticks, 0.8, rng), 0.0)
    force: Matrix = (size * comes * changes)[:, np.newaxis] * way / np.linalg.norm(way)
    return force


def _wander(ticks: int, fastest_hz: float, rng: np.random.Generator) -> Vector:
    """Sum of four sines of 0.08 Hz and more; root mean square 0.7."""
    t = 0.01 * np.arange(ticks)
    waves: Sequence[Vector] = [
        np.sin(2.0 * np.pi * (rng.uniform(0.08, fastest_hz) * t + rng.random())) for _ in range(4)
    ]
    total: Vector = 0.5 * np.sum(waves, axis=0)
    return total
