"""Quality of a stream without a plant: delay, tracking error, jerk, false stops, and targets that
no arm can follow."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from bench.study.streamed import Motion, Track, arrivals, stream_of
from common.arrays import Vector
from daemon.assembly import build_motion
from daemon.config.load import Robot
from daemon.config.vectors import limits_of
from daemon.modes.table import Mode
from daemon.motion.path import PathPoint
from daemon.motion.playout import Target
from daemon.motion.target_stream import STALLED_S

SETTLED_S: Final = 3.0  # after the first target, before a stream is judged
FAST: Final = 0.1  # [rad/s], from which on a motion shows its delay


@dataclass(frozen=True, slots=True)
class Quality:
    """Figures of one track against its motion."""

    delay_ms: float  # best constant fit
    error_mrad: float  # rms of the rest
    jerk: float  # rms [rad/s3]
    reported_ms: float  # median delay that the stream reports
    beyond: tuple[float, float]  # p50 and p95 of the delay beyond the reported one [ticks]


def quality(track: Track, motion: Motion, period_s: float) -> Quality:
    """Figures of a track after SETTLED_S."""
    chosen = track.time_s > track.time_s[0] + SETTLED_S
    time_s, q = track.time_s[chosen], track.q[chosen]
    delays = np.arange(0.0, 0.25, 0.001)
    fine = np.array([motion(t) for t in np.arange(0.0, time_s[-1] + 0.01, 1e-3)])

    def behind(delay_s: float) -> np.ndarray:
        rows = np.clip(np.round((time_s - delay_s) / 1e-3).astype(int), 0, len(fine) - 1)
        beside: np.ndarray = q - fine[rows]
        return beside

    errors = [float(np.sqrt(np.mean(behind(d) ** 2))) for d in delays]
    best = int(np.argmin(errors))
    jerk = np.diff(track.velocity[chosen], 2, axis=0) / period_s**2
    reported_s = float(np.median(track.delay_s[chosen]))
    rest = behind(reported_s)
    rows = np.clip(np.round((time_s - reported_s) / 1e-3).astype(int), 1, len(fine) - 2)
    speed = (fine[rows + 1] - fine[rows - 1]) / 2e-3
    moving = np.abs(speed) > FAST
    beyond = np.abs(-rest[moving] / speed[moving]) / period_s
    p50, p95 = np.percentile(beyond, (50, 95)) if moving.any() else (math.nan, math.nan)
    return Quality(
        1e3 * float(delays[best]),
        1e3 * errors[best],
        float(np.sqrt(np.mean(jerk**2))),
        1e3 * reported_s,
        (float(p50), float(p95)),
    )


def false_stops(robot: Robot, rate_hz: float, hours: float, seed: int) -> tuple[int, int]:
    """Number of ends, and of stalls, of a lossy stream whose sender is alive."""
    seconds = 3600.0 * hours
    ended, stalled, was = 0, 0, False
    period_s = robot.configuration.period_s
    q = np.zeros(len(robot.configuration.joints))
    coming = iter(arrivals(lambda _: q, rate_hz, seconds, seed))
    first = next(coming)
    stream = stream_of(robot, first.target)
    following = next(coming, None)
    for tick in range(1, round(seconds / period_s)):
        now_s = first.at_s + tick * period_s
        while following is not None and following.at_s <= now_s:
            stream.put(following.target)
            following = next(coming, None)
        stream.tick(period_s)
        if following is None:
            break
        silent = stream.silent_s > STALLED_S
        stalled += silent and not was
        was = silent
        ended += stream.ended
    return ended, stalled


# --- targets that no arm can follow -------------------------------------------------------------


def wild(robot: Robot, seed: int) -> Iterator[Target]:
    """Targets that jump, exceed the limits, are not numbers, or go back in time."""
    rng = np.random.default_rng((seed, 46))
    n, number, sent_s = len(robot.configuration.joints), 0, 0.0
    while True:
        number += int(rng.integers(-2, 4))
        sent_s += float(rng.choice([-0.05, 0.0, 0.01, 0.01, 0.02, 1.0]))
        q = rng.uniform(-4.0, 4.0, n) * rng.choice([0.1, 1.0, 1e6])
        if rng.random() < 0.1:
            q[rng.integers(n)] = rng.choice([np.nan, np.inf, -np.inf])
        velocity = rng.uniform(-9.0, 9.0, n) if rng.random() < 0.3 else None
        yield Target(number, sent_s, q, velocity)


def beyond_limits(robot: Robot, seed: int, seconds: float = 2.0) -> int:
    """Number of setpoints beyond a limit of velocity or acceleration, and of poses beyond a joint
    limit, of an ideal arm that is sent wild targets from rest."""
    c = robot.configuration
    motion, limits, period_s = build_motion(robot, links_trusted=True), limits_of(c), c.period_s
    rng = np.random.default_rng((seed, 47))
    q: Vector = limits.lower + (limits.upper - limits.lower) * rng.random(len(c.joints))
    stream = stream_of(robot, Target(0, 0.0, q))
    motion.follower.place = PathPoint(stream)
    motion.follow(q)
    targets, beyond, push = wild(robot, seed), 0, np.zeros_like(q)
    for _ in range(round(seconds / period_s)):
        for _ in range(int(rng.integers(0, 3))):
            stream.put(next(targets))
        stream.tick(period_s)
        before = motion.velocity
        motion.step(Mode.TRACKING, q, None, push, period_s)
        velocity = motion.velocity
        q = q + velocity * period_s
        beyond += bool((np.abs(velocity) > limits.velocity * (1 + 1e-9)).any())
        beyond += bool((np.abs(velocity - before) > limits.acceleration * period_s + 1e-9).any())
        beyond += bool(((q < limits.lower - 1e-6) | (q > limits.upper + 1e-6)).any())
    return beyond
