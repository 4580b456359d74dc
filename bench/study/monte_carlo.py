"""Runs of arms of the population, one arm and one kind of run each, on several processors.

free     contact-free motion of all joints, with stops        -> alarms, lowest thresholds moving
steps of torque on single joints, in motion          -> trials, errors rest     the same while the
arm stands after a motion         -> trials

Every arm has worked before, untouched, and keeps what it learned.
"""

import dataclasses
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bench.rigs.arm_without_bus import Recording, Scenario, record, recordings
from bench.study import courses, population, scores, world
from bench.study.estimates import Estimates, build, estimates
from bench.study.population import STEP_MS, Step
from bench.study.scores import Errors, Trial, count_alarms, quiet_threshold
from bench.study.world import Gears, Law
from common.arrays import Matrix, Vector
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration

Kind = Literal["free", "moving", "rest"]
MOVING = 0.05  # [rad/s]
SMOOTH = 10  # ticks over which a motor's torque is averaged
GRACE_S = 1.0  # Alarms count from here on: an arm is not armed immediately.


@dataclass(frozen=True, slots=True)
class Job:
    """One run of one arm."""

    robot: Path
    kind: Kind
    friction: Law
    seed: int
    seconds: float
    motor_position: Literal["measured", "integrated"]
    worked_s: float = 600.0  # at work before
    gears: Gears = "modelled"
    link_encoder: bool = True  # False: the motor's encoder stands for the link's


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of a run; arrays are (variants, n)."""

    job: Job
    names: tuple[str, ...]
    alarms: NDArray[np.int64]
    """of the residual that decides, at its levels in force; of the rivals, at those of the
    configuration, raised near rest"""
    quiet: Matrix  # lowest thresholds without an alarm [Nm], learning aside
    level: Matrix  # (n,): median in motion, in force after the work before [Nm]
    errors: tuple[Errors, ...]  # by variant: against the filtered truth while engaged
    trials: tuple[Trial, ...]


def run(job: Job) -> Result:
    """Result of one job: simulated, estimated and judged."""
    robot = load_robot(job.robot)
    c = robot.configuration
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    subject = world.subject(robot, job.friction, job.seed, job.gears)
    how = {"motor_position": job.motor_position}
    believed = robot if job.link_encoder else without_link_encoder(robot)
    estimator = build(believed, **how)
    course, _ = courses.day(c, job.seed, job.worked_s)
    level = contact
    work = Scenario(seconds=job.worked_s, motion=course, begin_s=-job.worked_s)
    for before in recordings(subject, work):
        seen = before if job.link_encoder else motors_alone(before)
        level = _in_motion(seen, estimates(estimator, seen), level)
    estimator.restart()
    scenario, steps = _scenario(job, c, level, estimator.levels_at(0.0 * contact))
    recording = record(subject, scenario)
    if not job.link_encoder:
        recording = motors_alone(recording)
    found = estimates(estimator, recording)
    # Rivals have their own levels, raised as without learning.
    unlearned = estimates(build(believed, learning=False, beside=(), **how), recording)
    raised = np.array([found.threshold, *[unlearned.threshold] * (len(found.residuals) - 1)])
    raised -= contact
    armed = recording.time_s > GRACE_S
    external = recording.mean(found.delay_s, recording.external)
    truth = scores.filtered(external, c.estimator.gain, c.period_s)
    touching = recording.mean(found.delay_s, recording.apart) == 0.0
    residuals = found.residuals.values()
    pairs = [(r[armed], above[armed]) for r, above in zip(residuals, raised, strict=True)]
    return Result(
        job=job,
        names=tuple(found.residuals),
        alarms=np.array([count_alarms(r, contact + above) for r, above in pairs]),
        quiet=np.array([quiet_threshold(r, above) for r, above in pairs]),
        level=level,
        errors=tuple(Errors.of(r - truth, touching & armed[:, np.newaxis]) for r in residuals),
        trials=tuple(_trial(step, recording, found, raised, c) for step in steps),
    )


def without_link_encoder(robot: Robot) -> Robot:
    """Robot as described by an owner who has motor encoders only: without a gap."""
    c = robot.configuration
    joints = [replace(joint, half_gap=0.0) for joint in c.joints]
    return dataclasses.replace(robot, configuration=replace(c, joints=joints))


def motors_alone(recording: Recording) -> Recording:
    """Recording with the motor position, at the link side, in place of the link's."""
    samples = recording.samples.copy()
    samples[:, 1] = samples[:, 3]
    return dataclasses.replace(recording, samples=samples)


def _in_motion(recording: Recording, found: Estimates, otherwise: Vector) -> Vector:
    """Median level in force (n,) [Nm] while each joint moves, if it does for a second."""
    moving = np.abs(recording.samples[:, 2]) > MOVING
    enough = np.count_nonzero(moving, axis=0) > 100
    chosen = np.where(moving | ~enough, found.threshold, np.nan)
    level: Vector = np.where(enough, np.nanmedian(chosen, axis=0), otherwise)
    return level


def _scenario(
    job: Job, c: Configuration, moving: Vector, resting: Vector
) -> tuple[Scenario, list[Step]]:
    """moving, resting: levels in force (n,) [Nm]; the usual step is twice as large."""
    seed, seconds = job.seed, job.seconds
    _, _, most = population.sizes(c)
    steps: list[Step] = []
    match job.kind:
        case "free":
            path = population.motion(c, seed, go_s=20.0, rest_s=3.0)
        case "moving":
            path = population.motion(c, seed, held=0.0)
            onsets = population.onsets_in_motion(seconds, seed)
            steps = population.steps(c, seed, onsets, np.minimum(2.0 * moving, most))
        case "rest":
            path = population.motion(c, seed, go_s=population.GO_S, rest_s=population.REST_S)
            onsets = population.onsets_at_rest(seconds, seed)
            steps = population.steps(c, seed, onsets, np.minimum(2.0 * resting, most))
    pushes = population.pushes(steps, len(c.joints))
    return Scenario(seconds=seconds, motion=path, pushes=pushes), steps


def _trial(
    step: Step, recording: Recording, found: Estimates, raised: NDArray[Any], c: Configuration
) -> Trial:
    """Part of the run around one step."""
    per_tick, i = recording.per_tick, step.joint
    # SYNC k comes after per_tick * (k + 1) milliseconds.
    first = step.onset_ms // per_tick
    ticks = slice(first, first + STEP_MS // per_tick)
    sign = np.sign(step.torque)
    residuals = sign * np.array([r[:, i] for r in found.residuals.values()])
    begin = per_tick * (1 + np.arange(ticks.start, ticks.stop))
    apart = np.cumsum(recording.apart[step.onset_ms : per_tick * ticks.stop, i])
    return Trial(
        joint=i,
        size=abs(step.torque),
        delay_s=np.asarray(1e-3 * (begin - step.onset_ms), dtype=np.float64),
        residuals=residuals[:, ticks],
        before=residuals[:, first - 1],
        raised=raised[:, ticks, i],
        travelled=apart[begin - step.onset_ms - 1] > 0,
        hidden=abs(step.torque) - _reached(step, recording, first, c.joints[i].torque_constant),
        breakaway=float(recording.breakaway[i]),
        moving=bool(np.abs(recording.samples[ticks, 2, i]).min() > MOVING),
    )


def _reached(step: Step, recording: Recording, first: int, torque_constant: float) -> float:
    """Torque [Nm] with which the motor opposes the step at its end, over SMOOTH ticks."""
    torque = -np.sign(step.torque) * torque_constant * recording.samples[:, 0, step.joint]
    end = first + STEP_MS // recording.per_tick
    return float(np.mean(torque[end - SMOOTH : end]) - np.mean(torque[first - SMOOTH : first]))


T = TypeVar("T")
R = TypeVar("R")


def spread(work: Callable[[T], R], jobs: Iterable[T], processes: int, title: str) -> Iterator[R]:
    """work(job) for every job, in order of completion, with a progress bar on standard error."""
    todo = list(jobs)
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=len(todo))
        if processes == 1:
            for job in todo:
                yield work(job)
                bar.advance(task)
            return
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, mp_context=spawn) as pool:
            for done in as_completed([pool.submit(work, job) for job in todo]):
                yield done.result()
                bar.advance(task)
