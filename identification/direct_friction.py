"""Friction by its definition: half the difference of torque (up - down) / 2 between the strokes of
a joint that moves alone to and fro at one speed, at the same positions. No masses, no fit."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from estimator.transmission import Transmission
from identification.gap_result import resolution, smoothed
from identification.motion_log import PAUSE_S, MotionLog
from identification.regression import NORMAL_95

_SLOWEST, _NOISE = 0.01, 0.002  # [rad/s]; a slower joint is at rest
_EVEN, _ALONG = 0.05, 0.2  # of the speed: its variation, and the link's against the motor's
_STILL, _SHAKEN = 0.1, 21  # of the speed, up to which another joint stands; samples around more
_BEGIN_S = 0.6  # of a stroke, while friction reverses and the position loop settles
_SHARED, _SAME_POSE = 0.1, 0.01  # of a stroke, by the return stroke; [rad] of the others
_FEWEST, _FEWEST_STROKES = 15, 3  # samples of a stroke; strokes
_BIN, _CELLS = 0.1, 4  # range of positions for a point [rad], and its number of cells
_UNEVEN = 0.01  # of friction


@dataclass(frozen=True, slots=True)
class Point:
    """Friction at one load [Nm], the mean torque of both strokes, and speed [rad/s]: the median of
    half the differences [Nm]; scatter: two standard deviations of them, half a step of the current,
    and 1 % for uneven motion [Nm]."""

    load: float
    speed: float
    friction: float
    scatter: float


@dataclass(frozen=True, slots=True)
class Law:
    """Friction that the estimator subtracts from joint `i`, and standard errors of its Coulomb [Nm]
    and viscous friction [Nm s/rad]."""

    transmission: Transmission
    i: int
    errors: tuple[float, float]

    def at(self, load: float, speed: float) -> tuple[float, float]:
        """Friction at a load [Nm] and a speed > 0 [rad/s], and half of its 95 % interval [Nm]."""
        t, i = self.transmission, self.i
        rubs = float(t.link_coulomb[i] + t.link_viscous[i] * speed)
        carried = max(abs(load), rubs)  # mean of |load + rubs| and |load - rubs|
        coulomb = float(t.engaged_coulomb[i] + t.load_friction[i] * carried)
        # Near rest between smooth friction and one that sticks.
        smooth = float(np.tanh(speed / t.sign_width))
        least, most = (float(share[i]) for share in (t.least_stiction, t.most_stiction))
        built = smooth + (1.0 - smooth) * 0.5 * (least + most)
        off = [NORMAL_95 * self.errors[0], NORMAL_95 * self.errors[1] * speed]
        off += [t.load_friction_error[i] * carried, coulomb * (1.0 - smooth) * 0.5 * (most - least)]
        friction = coulomb * built + float(t.motor_viscous[i] + t.link_viscous[i]) * speed
        return friction, float(np.linalg.norm(off))

    def misses(self, point: Point) -> tuple[float, float]:
        """Measured friction minus this, and its part beyond scatter and interval, >= 0 [Nm]."""
        friction, half = self.at(point.load, point.speed)
        more = point.friction - friction
        return more, max(abs(more) - point.scatter - half, 0.0)


@dataclass(frozen=True, slots=True)
class SteadyStroke:
    """Steady part of one stroke: positions and torque (N,), signed speed, mean of positions
    (n,)."""

    q: Vector
    torque: Vector
    speed: float
    pose: Vector


def grouped_strokes(
    log: MotionLog, i: int, constant: float, delay_s: float
) -> list[list[SteadyStroke]]:
    """Strokes of joint i, grouped by those that follow each other to and fro at one speed while all
    other joints stand. constant: K_c [Nm/A]; delay_s: delay of the current [s]."""
    groups: list[list[SteadyStroke]] = [[]]
    for stroke in _steady_strokes(log, i, constant, delay_s):
        if groups[-1] and not _goes_back(groups[-1][-1], stroke, i):
            groups.append([])
        groups[-1].append(stroke)
    return [strokes for strokes in groups if len(strokes) >= _FEWEST_STROKES]


def points(groups: Sequence[Sequence[SteadyStroke]]) -> list[Point]:
    """Friction at each load and speed that neighbouring strokes share."""
    return [point for strokes in groups for point in _of_one_speed(strokes)]


def _steady_strokes(log: MotionLog, i: int, constant: float, delay_s: float) -> list[SteadyStroke]:
    v = np.stack([smoothed(column, 9) for column in log.motor_velocity.T], axis=1)
    own, q = v[:, i], log.link_position[:, i]
    q_dot = np.gradient(smoothed(q, 9), log.time_s)
    still = np.maximum(_SLOWEST, _STILL * np.abs(own))[:, None]
    moving = (np.abs(np.delete(v, i, axis=1)) > still).any(axis=1)
    alone = np.convolve(moving, np.ones(_SHAKEN), mode="same") < 0.5
    direction = np.where(np.abs(own) > _SLOWEST, np.sign(own), 0.0)
    pause = np.diff(log.time_s, prepend=log.time_s[0]) > PAUSE_S
    edges = np.flatnonzero((np.diff(direction, prepend=0.0) != 0.0) | pause).tolist()
    found = []
    for a, b in itertools.pairwise([*edges, len(direction)]):
        speed = float(np.median(own[a:b]))
        even = alone[a:b] & (np.abs(own[a:b] - speed) < _EVEN * abs(speed) + _NOISE)
        even &= np.abs(q_dot[a:b] - speed) < _ALONG * abs(speed)
        even &= log.time_s[a:b] > log.time_s[a] + _BEGIN_S
        rows = a + np.flatnonzero(even)
        if direction[a] and len(rows) >= _FEWEST:
            pose, at = log.link_position[rows].mean(axis=0), q[rows] - speed * delay_s
            found.append(SteadyStroke(at, constant * log.current[rows, i], speed, pose))
    return found


def _goes_back(a: SteadyStroke, b: SteadyStroke, i: int) -> bool:
    """True if b is the return stroke of a: same speed, same positions, the other joints unmoved."""
    moved = np.abs(np.delete(a.pose - b.pose, i))
    if abs(a.speed + b.speed) > _ALONG * abs(a.speed) or (moved > _SAME_POSE).any():
        return False
    shared = min(a.q.max(), b.q.max()) - max(a.q.min(), b.q.min())
    return bool(shared > _SHARED * min(np.ptp(a.q), np.ptp(b.q)))


def _of_one_speed(strokes: Sequence[SteadyStroke]) -> Iterator[Point]:
    low, high = max(one.q.min() for one in strokes), min(one.q.max() for one in strokes)
    count = max(1, round((high - low) / _BIN))
    cells = np.linspace(low, max(low, high), _CELLS * count + 1)
    torque = np.stack([_mean(stroke, cells) for stroke in strokes])
    sign = np.sign([stroke.speed for stroke in strokes[:-1]])[:, None]
    friction, load = 0.5 * sign * (torque[:-1] - torque[1:]), 0.5 * (torque[:-1] + torque[1:])
    speed = float(np.mean([abs(stroke.speed) for stroke in strokes]))
    unsure = 0.5 * min(resolution(stroke.torque) for stroke in strokes)
    for halves, loads in zip(
        *(np.split(of, count, axis=1) for of in (friction, load)), strict=True
    ):
        if (seen := np.isfinite(halves)).sum() >= _CELLS:
            half = float(np.median(halves[seen]))
            scatter = 2.0 * float(halves[seen].std(ddof=1)) + unsure + _UNEVEN * abs(half)
            yield Point(float(loads[seen].mean()), speed, half, scatter)


def _mean(stroke: SteadyStroke, cells: Vector) -> Vector:
    """Mean torque in each cell of positions; NaN where the stroke has no sample."""
    count, total = (np.histogram(stroke.q, cells, weights=w)[0] for w in (None, stroke.torque))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
