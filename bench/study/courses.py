"""Courses: motions of an arm for minutes, one kind after the other.

    sinusoids       all joints at once, with a soft start
    point to point  poses of the workspace, with rests between
    creep           to and fro at 0.02 rad/s
    reversals       one joint at a time to and fro, the others holding
    holding         none

A course is a table of q_d and its velocity, a row per tick. Each part begins and ends at rest, and
begins where the previous one ended.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.rigs.arm_without_bus import Course
from common.arrays import Vector
from daemon.config.schema import Configuration

CLEARANCE: Final = 0.1  # [rad] between a course and the joint limits
CREEP: Final = 0.02  # [rad/s]
_SPEED_SHARE: Final = 0.6  # of a joint's velocity limit
_RAMP_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Room:
    """Range of a course: bounds (n,) [rad], speeds (n,) [rad/s], and the period [s]."""

    lower: Vector
    upper: Vector
    fastest: Vector
    period_s: float

    @classmethod
    def of(cls, c: Configuration) -> "Room":
        """Range within an arm's limits."""
        return cls(
            np.array([joint.limits.lower for joint in c.joints]) + CLEARANCE,
            np.array([joint.limits.upper for joint in c.joints]) - CLEARANCE,
            _SPEED_SHARE * np.array([joint.limits.velocity for joint in c.joints]),
            c.period_s,
        )

    def times(self, seconds: float) -> Vector:
        """Times [s] of the ticks of a part."""
        ticks: Vector = np.arange(1.0, round(seconds / self.period_s) + 1)
        return self.period_s * ticks


Part = Callable[[Room, Vector, float, np.random.Generator], Course]
"""(room, initial pose (n,), seconds, rng) -> course"""


def holding(room: Room, start: Vector, seconds: float, rng: np.random.Generator) -> Course:
    """Stand at `start`."""
    del rng
    q = np.tile(start, (len(room.times(seconds)), 1))
    return Course(q, np.zeros_like(q))


def move(room: Room, start: Vector, end: Vector) -> Course:
    """From rest to rest, all joints at once: q = start + distance (10 u^3 - 15 u^4 + 6 u^5)."""
    distance = end - start
    seconds = max(0.5, float(np.max(1.875 * np.abs(distance) / room.fastest)))
    u = np.minimum(room.times(seconds + room.period_s) / seconds, 1.0)[:, np.newaxis]
    shape, slope = u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * (1.0 - u)) ** 2 / seconds
    return Course(start + distance * shape, distance * slope)


def sinusoids(room: Room, start: Vector, seconds: float, rng: np.random.Generator) -> Course:
    """Around `start`; one joint in seven holds."""
    n = len(start)
    omega = 2.0 * np.pi * rng.uniform(0.08, 0.4, n)
    reach = np.minimum(0.5, np.minimum(start - room.lower, room.upper - start))
    amplitude = np.maximum(np.minimum(reach, room.fastest / omega), 0.0) * rng.uniform(0.4, 1.0, n)
    amplitude *= (rng.random(n) > 1 / 7) * rng.choice((-1.0, 1.0), n)
    t = room.times(seconds)
    rate = np.clip(np.minimum(t, seconds - t) / _RAMP_S, 0.0, 1.0)
    s = room.period_s * np.cumsum(rate)
    angle = omega * s[:, np.newaxis]
    velocity = amplitude * omega * np.cos(angle) * rate[:, np.newaxis]
    return Course(start + amplitude * np.sin(angle), velocity)


def point_to_point(room: Room, start: Vector, seconds: float, rng: np.random.Generator) -> Course:
    """Poses within 0.8 rad, with rests of 0.3 to 4 s."""
    parts, here, left = [], start, seconds
    while left > 0.0:
        end = np.clip(here + rng.uniform(-0.8, 0.8, len(start)), room.lower, room.upper)
        part = joined([move(room, here, end), holding(room, end, rng.uniform(0.3, 4.0), rng)])
        left -= len(part.q) * room.period_s
        here = end
        parts.append(part)
    return joined(parts)


def creep(room: Room, start: Vector, seconds: float, rng: np.random.Generator) -> Course:
    """Each joint to and fro at CREEP, with distances and pauses of its own."""
    columns = [_creep_of_one(room, i, start[i], seconds, rng) for i in range(len(start))]
    q = np.stack([column.q for column in columns], axis=1)
    return Course(q, np.stack([column.velocity for column in columns], axis=1))


def _creep_of_one(
    room: Room, i: int, start: float, seconds: float, rng: np.random.Generator
) -> Course:
    ticks = len(room.times(seconds))
    velocity, direction = np.zeros(ticks), rng.choice((-1.0, 1.0))
    begin = 0
    while begin < ticks:
        end = begin + round(rng.uniform(3.0, 12.0) / room.period_s)
        velocity[begin:end] = direction * CREEP
        begin = end + round(rng.uniform(0.0, 3.0) / room.period_s)
        direction = -direction
    q = start + room.period_s * np.cumsum(velocity)
    inside = (q > room.lower[i]) & (q < room.upper[i])
    if not inside.all():  # stands at its limit
        velocity[np.argmin(inside) :] = 0.0
        q = start + room.period_s * np.cumsum(velocity)
    return Course(q, velocity)


def reversals(room: Room, start: Vector, seconds: float, rng: np.random.Generator) -> Course:
    """One joint after the other, three times to and fro over 0.05 to 0.6 rad."""
    parts, here, left = [], start, seconds
    while left > 0.0:
        for i in rng.permutation(len(start)):
            end = here.copy()
            step = rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.6)
            end[i] = np.clip(here[i] + step, room.lower[i], room.upper[i])
            there, back = move(room, here, end), move(room, end, here)
            parts += [there, back] * 3
            left -= 3 * (len(there.q) + len(back.q)) * room.period_s
            if left <= 0.0:
                break
    return joined(parts)


PARTS: Final[dict[str, Part]] = {
    "sinusoids": sinusoids,
    "point to point": point_to_point,
    "creep": creep,
    "reversals": reversals,
    "holding": holding,
}


def joined(parts: list[Course]) -> Course:
    """Courses, one after the other."""
    return Course(
        np.concatenate([part.q for part in parts]),
        np.concatenate([part.velocity for part in parts]),
    )


def day(
    c: Configuration, seed: int, seconds: float, part_s: float = 30.0
) -> tuple[Course, NDArray[np.int64]]:
    """Course with every kind of part in turn, in random order, with a move to another pose after
    each, a row for every tick of `seconds`; and the index in PARTS of each tick."""
    rng, room = np.random.default_rng((seed, 21)), Room.of(c)
    here = rng.uniform(room.lower, room.upper)
    parts, kinds, wanted = list[Course](), list[int](), round(seconds / room.period_s)
    while len(kinds) < wanted:
        for kind in rng.permutation(len(PARTS)).tolist():
            name = list(PARTS)[kind]
            part = PARTS[name](room, here, part_s / 3.0 if name == "holding" else part_s, rng)
            there = rng.uniform(room.lower, room.upper)
            parts += [part, move(room, part.q[-1], there)]
            kinds += [kind] * (len(part.q) + len(parts[-1].q))
            here = there
    whole = joined(parts)
    return Course(whole.q[:wanted], whole.velocity[:wanted]), np.array(kinds[:wanted])
