"""Contact on an arm that follows a stream: touches compared with those on the same motion as a
trajectory, false contacts, and the duration of a tick. The whole tick runs, around an arm without a
bus."""

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import world
from bench.study.streamed import TREMOR, Arrival, Motion, arrivals, hand
from common.arrays import Vector
from daemon.config.load import Robot
from daemon.config.vectors import limits_of, stream_settings_of
from daemon.modes.table import Event, Mode
from daemon.motion.limits import Limits
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.motion.target_stream import TargetStream

KNOTS_S: Final = 0.02
EVERY_S: Final = 5.0
TOUCH_S: Final = 0.5
FAST: Final = 0.05  # [rad/s], from which on a joint counts as moving


@dataclass(frozen=True, slots=True)
class Work:
    """Contacts of one arm at work."""

    felt_s: tuple[float, ...]  # delay of each touch; infinite: missed
    false: int
    hours: float
    tick_s: tuple[float, ...]  # durations of ticks, every tenth


def work(
    robot: Robot, rate_hz: float, seed: int, seconds: float, *, streamed: bool, touched: bool
) -> Work:
    """Work of one arm of the population, not armed, on the motion of a hand, streamed or not."""
    c = robot.configuration
    subject = replace(world.subject(robot, world.LAWS[seed % 3], seed), drift=0.0)
    limits = limits_of(c)
    motion = hand(limits, seconds, seed, 0.0 if touched else TREMOR)
    on = ArmInTheLoop(subject, robot, motion(0.0))
    on.run(0.5)
    on.request(Event.ENABLE)
    on.run(0.5)
    coming = arrivals(motion, rate_hz, seconds, seed)
    first = coming[0].target
    stream = TargetStream("the bench", stream_settings_of(c), limits, first) if streamed else None
    on.request(Event.START, stream or _path(robot, limits, motion, seconds))
    return _at_work(on, stream, coming, seed, seconds, touched=touched)


def _path(robot: Robot, limits: Limits, motion: Motion, seconds: float) -> SampledPath:
    c = robot.configuration
    joints, ramp_s = c.joint_names, c.trajectory.ramp_s
    builder = PathBuilder("hand", joints, joints, limits, ramp_s, from_here=True)
    times = np.arange(0.0, seconds, KNOTS_S)
    q = np.array([motion(t) for t in times.tolist()])
    velocity = np.gradient(q, KNOTS_S, axis=0)
    builder.append(np.column_stack((times, q, velocity)).tolist())
    return builder.finish()


def _at_work(
    on: ArmInTheLoop,
    stream: TargetStream | None,
    coming: list[Arrival],
    seed: int,
    seconds: float,
    *,
    touched: bool,
) -> Work:
    rng = np.random.default_rng((seed, 48))
    joints = len(on.robot.configuration.joints)
    felt, false, durations, k = [], 0, [], 0
    begun_s, was, since_s = on.time_s, False, -np.inf
    due_s, joint, delay = EVERY_S, 0, None
    push: Vector = np.zeros(joints)
    for tick in range(round((seconds - 1.0) / on.period_s)):
        now_s = on.time_s - begun_s
        before_s = time.perf_counter()
        while stream is not None and k < len(coming) and coming[k].at_s <= now_s:
            stream.put(coming[k].target)
            k += 1
        spent_s = time.perf_counter() - before_s
        on.drives.external[:] = push
        on.tick.begin(on.time_s)
        before_s = time.perf_counter()
        on.tick.finish(0.0)
        if tick % 10 == 0:
            durations.append(spent_s + time.perf_counter() - before_s)
        on.ticks += 1
        contact = bool(on.estimate.thresholded.any())
        if delay is None and touched and now_s >= due_s and on.mode is Mode.TRACKING:
            joint = int(rng.integers(joints)) if now_s - due_s < on.period_s else joint
            speed = float(on.harness.plant.q_dot[joint])
            if abs(speed) > FAST and not on.harness.plant.in_gap[joint] and not contact:
                push[joint] = -2.0 * np.sign(speed) * float(on.estimate.threshold[joint])
                delay, since_s = np.inf, now_s
        elif delay is not None:
            if contact and np.isinf(delay):
                delay = now_s - since_s
            if now_s - since_s >= TOUCH_S:
                felt.append(float(delay))
                push[:], delay, due_s = 0.0, None, now_s + EVERY_S
        false += contact and not was and now_s > since_s + TOUCH_S + 1.0 and now_s > 1.0
        was = contact
        # A collision may have halted it too close to a limit for the rest of a path.
        if on.mode is Mode.HOLDING and on.tick.controller.request(
            Event.START, "the bench", on.time_s
        ):
            break
    return Work(tuple(felt), false, seconds / 3600.0, tuple(durations))
