"""Strokes of a motor that turns slowly to and fro: their steady parts, and the torque held."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from identification.gap_result import resolution, smoothed

FASTEST = 0.045
"""[rad/s]: at higher speeds impacts and swinging of the link matter."""
_BEGIN_S = 0.15  # of a stroke, in which the motor's friction reverses
_FEWEST = 5  # samples, in each direction
_FEWEST_FREE = 5  # samples inside the gap
_FEWEST_WARM = 6  # strokes
_FEWEST_TURNS = 3  # strokes
_LEAST, _MOST = 0.5, 0.9  # of all friction: surely the rotor's, and the most shown as such
_WITHIN = 0.8  # of the half-gap
_SHOWN = 1.0  # [rad], within which gravity must exceed friction to show


@dataclass(frozen=True, slots=True)
class Samples:
    """Steady parts of the strokes; all (N,)."""

    time_s: Vector
    phi: Vector
    theta: Vector
    torque: Vector
    direction: Vector
    """of the motor, +-1"""
    follows: Vector
    """speed of phi over the motor's: 0 if the link follows, -1 if it stays"""
    stroke: NDArray[np.int64]
    late: NDArray[np.bool_]
    """Not at the beginning of a stroke"""
    resolution: float
    """of the coarser encoder [rad]"""
    turns: Matrix
    """Rows of time, phi, torque in the motor's direction and stroke, from its reversal on, while
    its link stays (M, 4)"""


def stroking(theta_dot: Vector) -> bool:
    """True if a motor turned at one slow speed whenever it turned, as for `from_strokes`."""
    speed = np.abs(smoothed(theta_dot, 9))
    fast = float(np.percentile(speed, 90.0))
    moving = speed[speed > 0.3 * fast]
    return 0.005 < fast < FASTEST and float((moving > 0.7 * fast).mean()) > 0.7


def steady(time_s: Vector, q: Vector, theta: Vector, theta_dot: Vector, torque: Vector) -> Samples:
    period = float(np.median(np.diff(time_s)))
    v = smoothed(theta_dot, 9)
    fast = float(np.percentile(np.abs(v), 90.0))
    direction = np.where(np.abs(v) > 0.8 * fast, np.sign(v), 0.0)
    pause = np.diff(time_s, prepend=time_s[0]) > 3.0 * period
    edges = np.flatnonzero((np.diff(direction, prepend=direction[0]) != 0.0) | pause)
    phi = q - theta
    slope = np.gradient(smoothed(phi, 7), time_s)
    follows = slope / np.where(v == 0.0, 1.0, v)
    rows: list[NDArray[np.int64]] = []
    turns: list[Matrix] = [np.empty((0, 4))]
    stroke: list[NDArray[np.int64]] = []
    late: list[NDArray[np.bool_]] = []
    least, late_by, end = 0.3 / period, round(_BEGIN_S / period), 0
    for a, b in itertools.pairwise([0, *edges.tolist(), len(v)]):
        if not direction[a] or b - a < least:
            continue
        # A stroke that a lost sample cut in two is continued.
        before = rows[-1][-1] if rows else None
        goes_on = before is not None and direction[before] == direction[a]
        stroke.append(np.full(b - a, stroke[-1][-1] + (not goes_on) if rows else 0))
        late.append(np.arange(b - a) > late_by)
        rows.append(np.arange(a, b))
        other = np.flatnonzero((v[end:a] * direction[a] <= 0.0) | pause[end + 1 : a + 1])
        turn = np.arange(end + int(other[-1]) + 1 if len(other) else end, a + late_by)
        turn = turn[follows[turn] < -0.5]
        columns = time_s - time_s[0], phi, torque * direction[a], np.full_like(v, stroke[-1][0])
        turns.append(np.stack(columns, axis=1)[turn])
        end = b
    if not rows:
        none = np.empty(0, dtype=np.int64)
        rows, stroke, late = [none], [none], [none.astype(np.bool_)]
    at = np.concatenate(rows)
    return Samples(
        time_s=time_s[at] - time_s[0],
        phi=smoothed(phi, 3)[at],
        theta=theta[at],
        torque=smoothed(torque, 3)[at],
        direction=direction[at],
        follows=follows[at],
        stroke=np.concatenate(stroke),
        late=np.concatenate(late),
        resolution=max(resolution(q), resolution(theta)),
        turns=np.concatenate(turns),
    )


def whole_strokes(seen: Samples) -> list[NDArray[np.int64]]:
    """Rows of each stroke that ends at a reversal: the last may only return to the middle."""
    rows = [np.flatnonzero(seen.stroke == k) for k in range(int(seen.stroke[-1]) + 1)]
    short = len(rows) > 1 and len(rows[-1]) < 0.7 * max(len(own) for own in rows)
    return rows[:-1] if short else rows


def balance(
    time_s: Vector, q: Vector, theta: Vector, theta_dot: Vector, torque: Vector, slope: float
) -> float:
    """Link position [rad] at which the load in a log of strokes would be zero, if it grows by
    `slope` [Nm/rad]; NaN if so little gravity does not show beside friction."""
    held = held_by(steady(time_s, q, theta, theta_dot, torque), slope)
    if held is None or abs(slope) * _SHOWN < held.friction:
        return float("nan")
    return held.at - held.torque / slope


@dataclass(frozen=True, slots=True)
class Held:
    """Torque of the motor while its link followed: a line over the link's position, and
    friction."""

    at: float
    """middle of the positions [rad]"""
    torque: float
    """there [Nm]"""
    reach: float
    """change of that from the middle to either end [Nm]"""
    friction: float


def held_by(seen: Samples, slope: float | None = None) -> Held | None:
    """Torque that the motor held; None if it did not carry its link in both directions. slope: of
    the load over the link's position [Nm/rad], None if it is to be fitted."""
    carried = seen.late & (np.abs(seen.follows) < 0.25)
    if min((carried & (seen.direction == way)).sum() for way in (-1.0, 1.0)) < _FEWEST:
        return None
    q = (seen.phi + seen.theta)[carried]
    at, torque = 0.5 * float(q.min() + q.max()), seen.torque[carried]
    columns = [np.ones_like(q), seen.direction[carried]]
    if slope is None:
        columns.append(q - at)
    else:
        torque = torque - slope * (q - at)
    found, *_ = np.linalg.lstsq(np.stack(columns, axis=1), torque, rcond=None)
    steep = float(found[2]) if slope is None else slope
    return Held(at, float(found[0]), 0.5 * abs(steep) * float(np.ptp(q)), abs(float(found[1])))


def free_torque(seen: Samples, phi: Vector, alpha: float) -> tuple[Vector, float, float]:
    """Torque (N,) of the motor inside the gap on its way up [Nm], which is that down except for its
    sign, and changes as the motor warms; an offset of the current, common to both directions [Nm];
    and the error of the first, as a link that fell through the gap was not seen there."""
    even = np.ones_like(phi)
    inside = seen.late & (np.abs(phi) < 0.6 * alpha) & (seen.follows < -0.5)
    ways = [inside & (seen.direction == way) for way in (1.0, -1.0)]
    if min(int(one.sum()) for one in ways) >= _FEWEST_FREE:
        up, down = (float(np.median(seen.torque[one])) for one in ways)
        warms = _warming(seen, inside, 0.5 * (up + down))
        return 0.5 * (up - down) + warms, 0.5 * (up + down), 0.0
    if inside.sum() >= _FEWEST_FREE:
        return float(np.median((seen.torque * seen.direction)[inside])) * even, 0.0, 0.0
    held = held_by(seen)
    total = held.friction if held is not None else 0.0
    surely = float(np.clip(_turning(seen, phi, alpha), _LEAST * total, _MOST * total))
    return 0.5 * (total + surely) * even, 0.0, 0.5 * (total - surely)


def _turning(seen: Samples, phi: Vector, alpha: float) -> float:
    """Torque [Nm] that the motor took, in most strokes, before its link followed, in a gap so
    narrow that friction still reverses there: a lower bound of its friction."""
    time_s, phi_then, torque, stroke = seen.turns.T
    center = np.interp(time_s, seen.time_s, seen.phi - phi)
    inside = np.abs(phi_then - center) < _WITHIN * alpha
    most = [float(torque[inside & (stroke == k)].max()) for k in np.unique(stroke[inside])]
    return float(np.median(most)) if len(most) >= _FEWEST_TURNS else 0.0


def _warming(seen: Samples, inside: NDArray[np.bool_], offset: float) -> Vector:
    """Change (N,) of the motor's friction over time [Nm], by a line over the strokes; 0 of few."""
    friction = (seen.torque - offset) * seen.direction
    strokes = [inside & (seen.stroke == k) for k in np.unique(seen.stroke[inside])]
    if len(strokes) < _FEWEST_WARM:
        return np.zeros_like(friction)
    t, level = np.array([(seen.time_s[k].mean(), np.median(friction[k])) for k in strokes]).T
    slope = float(np.polyfit(t, level, 1)[0])
    return slope * (seen.time_s - float(np.median(seen.time_s[inside])))
