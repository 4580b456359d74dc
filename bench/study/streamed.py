"""Streams of targets as a network delivers them, and the response of an arm, without a plant.

A sender at 20 to 200 Hz sends poses of a motion; each arrives 2 to 12 ms later, and some are lost.
The motions are sines, and reaches like those of hands: minimum jerk (Flash and Hogan, 1985) over
0.1 to 0.6 rad in 0.4 to 1.5 s, with rests, and tremor of 0.3 mrad at 8 to 12 Hz.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from daemon.config.load import Robot
from daemon.config.vectors import limits_of, stream_settings_of
from daemon.motion.limits import Limits
from daemon.motion.path import Reference
from daemon.motion.playout import Target
from daemon.motion.target_stream import TargetStream

RATES_HZ: Final = (20.0, 50.0, 100.0, 200.0)
JITTER_S: Final = 0.01
LOSS: Final = 0.05
WAY_S: Final = 0.002  # least latency from sender to receiver
TREMOR: Final = 3e-4  # [rad]
FINE_S: Final = 1e-3  # spacing of the tables of a motion

Motion = Callable[[float], Vector]  # Pose (n,) [rad] at a time [s].


def sines(limits: Limits, seconds: float, seed: int) -> Motion:
    """All joints around their middles, at up to 60 % of their speed and 40 % of acceleration."""
    del seconds
    rng = np.random.default_rng((seed, 42))
    n = len(limits.lower)
    omega = 2.0 * np.pi * rng.uniform(0.1, 0.6, n)
    reach = np.minimum(0.4 * (limits.upper - limits.lower), 0.5)
    reach = np.minimum(reach, 0.6 * limits.velocity / omega)
    reach = np.minimum(reach, 0.4 * limits.acceleration / omega**2)
    middle, phase = 0.5 * (limits.lower + limits.upper), rng.uniform(0.0, 6.28, n)
    return lambda t: middle + reach * np.sin(omega * t + phase)


def hand(limits: Limits, seconds: float, seed: int, tremor: float = TREMOR) -> Motion:
    """Reaches with rests and tremor [rad], independent for each joint."""
    rng = np.random.default_rng((seed, 43))
    times = np.arange(0.0, seconds + 1.0, FINE_S)
    columns = [_reaches(limits, i, times, tremor, rng) for i in range(len(limits.lower))]
    table = np.array(columns)
    return lambda t: table[:, min(round(t / FINE_S), len(times) - 1)]


def _reaches(
    limits: Limits, i: int, times: Vector, tremor: float, rng: np.random.Generator
) -> Vector:
    lower, upper = limits.lower[i] + 0.05, limits.upper[i] - 0.05
    q = np.empty_like(times)
    here, k = 0.5 * (lower + upper), 0
    while k < len(times):
        goal = float(np.clip(here + rng.choice((-1, 1)) * rng.uniform(0.1, 0.6), lower, upper))
        distance = abs(goal - here)
        # Peaks of minimum jerk: 1.875 of the mean speed, 5.77 distance / time^2.
        fits = max(1.875 * distance / (0.7 * limits.velocity[i]), 0.0)
        fits = max(fits, float(np.sqrt(5.77 * distance / (0.4 * limits.acceleration[i]))))
        moving = max(round(max(rng.uniform(0.4, 1.5), fits) / FINE_S), 1)
        u = np.minimum(np.arange(1, moving + 1) / moving, 1.0)
        part = here + (goal - here) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        end = min(k + moving, len(times))
        q[k:end] = part[: end - k]
        rest = min(end + round(rng.uniform(0.0, 1.5) / FINE_S), len(times))
        q[end:rest] = goal
        here, k = goal, max(rest, k + 1)
    shaken: Vector = q + tremor * np.sin(2.0 * np.pi * rng.uniform(8.0, 12.0) * times)
    return shaken


MOTIONS: Final[dict[str, Callable[[Limits, float, int], Motion]]] = {"sines": sines, "hand": hand}


@dataclass(frozen=True, slots=True)
class Arrival:
    """Target and its time of arrival [s]."""

    at_s: float
    target: Target


def arrivals(motion: Motion, rate_hz: float, seconds: float, seed: int) -> list[Arrival]:
    """Targets of a motion in order of arrival."""
    rng = np.random.default_rng((seed, 44))
    count = int(seconds * rate_hz)
    late = WAY_S + rng.uniform(0.0, JITTER_S, count)
    there = rng.random(count) >= LOSS
    there[0] = True
    sent = [
        Arrival(k / rate_hz + late[k], Target(k, k / rate_hz, motion(k / rate_hz)))
        for k in range(count)
        if there[k]
    ]
    return sorted(sent, key=lambda one: one.at_s)


@dataclass(frozen=True, slots=True)
class Track:
    """References from a stream, a row per tick."""

    time_s: Vector
    q: Matrix
    velocity: Matrix
    delay_s: Vector  # that the stream reports


def stream_of(robot: Robot, first: Target) -> TargetStream:
    """Stream to a robot by its configuration, starting at its first target."""
    c = robot.configuration
    stream = TargetStream("the bench", stream_settings_of(c), limits_of(c), first)
    stream.go_on(first.q, again=False)
    return stream


def ticks(
    stream: TargetStream, coming: list[Arrival], seconds: float, period_s: float
) -> Iterator[tuple[float, Reference]]:
    """Time [s] and reference of each tick, while targets arrive, for an ideal arm."""
    k, begun_s, first = 0, coming[0].at_s, coming[0].target.q
    reference = Reference(first, np.zeros_like(first))
    for tick in range(1, round(seconds / period_s)):
        now_s = begun_s + tick * period_s
        while k < len(coming) and coming[k].at_s <= now_s:
            stream.put(coming[k].target)
            k += 1
        stream.tick(period_s)
        reference = stream.reference(reference.q, reference.velocity, period_s)
        yield now_s, reference


def track(robot: Robot, coming: list[Arrival], seconds: float) -> Track:
    """References from a stream of these targets."""
    stream = stream_of(robot, coming[0].target)
    rows = [
        (now_s, reference.q, reference.velocity, stream.delay_s)
        for now_s, reference in ticks(stream, coming, seconds, robot.configuration.period_s)
    ]
    time_s, q, velocity, delay_s = zip(*rows, strict=True)
    return Track(np.array(time_s), np.array(q), np.array(velocity), np.array(delay_s))
