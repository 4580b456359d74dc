"""Strokes of a motor in the check of its wiring, and their pieces in which the gear carries."""

import itertools
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from identification.motion_log import MotionLog

LEAST_MOTION = 0.005
"""[rad] that the motor must have turned."""
PIECE = 0.012
"""Length of a piece [rad], less than the motion of the link"""
_WHOLE = 0.75  # of the same, from which on a piece is complete
_FRAGMENT = 0.25  # of the longest stroke: a link that strikes its border halts the motor briefly
_MEASURED = 0.3  # least ratio of a motor's motion by position and velocity; else another's
_STEADY = 0.08  # change of the ratio of link and motor while the gear carries


@dataclass(frozen=True, slots=True)
class Stroke:
    """Piece of a stroke in which the gear carries: a link without load may bounce ahead of the
    motor and wait for it, and friction may hold one that fell to the other border."""

    rows: slice
    motor_travel: float
    """by the motor [rad], > 0"""
    link_travel: float
    """motion of the link in the direction of the motor [rad]"""
    steady: bool
    """The link moved by the same ratio in both halves"""
    upward: bool

    @property
    def carried(self) -> bool:
        """True if the gear moved the link along, whatever sign or scale is configured."""
        return self.steady and abs(self.link_travel) > 0.5 * self.motor_travel


def strokes_in(log: MotionLog, joint: int) -> list[Stroke]:
    """Last piece of `PIECE` of every stroke in which the gear carried; its end without one."""
    q, velocity = log.link_position[:, joint], log.motor_velocity[:, joint]
    steps = np.diff(log.time_s, prepend=log.time_s[0] - log.period_s)
    fast = np.abs(velocity) > 0.5 * np.percentile(np.abs(velocity), 90.0)
    direction = np.where(fast, np.sign(velocity), 0.0)
    edges = [0, *(np.flatnonzero(np.diff(direction)) + 1).tolist(), len(q)]
    ways = []
    for a, b in itertools.pairwise(edges):
        if direction[a] and b - a >= 10:
            motor = np.cumsum(np.abs(velocity[a:b]) * steps[a:b])
            if log.motor_position is not None:  # a coarse velocity is off by half a count, steadily
                by_position = direction[a] * log.motor_position[a:b, joint]
                if by_position[-1] - by_position[0] > _MEASURED * motor[-1]:
                    motor = np.maximum.accumulate(by_position)
            ways.append((a, motor - motor[0], direction[a] * (q[a:b] - q[a])))
    longest = max((float(motor[-1]) for _, motor, _ in ways), default=0.0)
    strokes = []
    for a, motor, link in ways:
        total = float(motor[-1])
        if total < max(LEAST_MOTION, _FRAGMENT * longest):
            continue
        piece = min(0.5 * total, PIECE)
        found = [_stroke(a, motor, link, end - piece, end, bool(direction[a] > 0.0))
                 for end in np.arange(total, piece, -0.5 * piece)]  # fmt: skip
        strokes.append(next((s for s in found if s.carried), found[0]))
    return strokes


def _stroke(
    first: int, motor: Vector, link: Vector, begin: float, end: float, upward: bool
) -> Stroke:
    """Motion of motor and link while the motor turned from `begin` to `end`."""
    a, middle, b = np.searchsorted(motor, [begin, 0.5 * (begin + end), end]).tolist()
    b = min(b, len(motor) - 1)
    early = (link[middle] - link[a]) / max(motor[middle] - motor[a], 1e-9)
    late = (link[b] - link[middle]) / max(motor[b] - motor[middle], 1e-9)
    return Stroke(
        rows=slice(first + a, first + b + 1),
        motor_travel=float(motor[b] - motor[a]),
        link_travel=float(link[b] - link[a]),
        steady=bool(abs(late - early) < _STEADY),
        upward=upward,
    )


def between(strokes: list[Stroke]) -> tuple[float, float]:
    """Least and largest motion of the link over that of the motor, in complete pieces in which the
    gear carried; in all such pieces if none is complete."""
    carried = [s for s in strokes if s.carried]
    ratios = [s.link_travel / s.motor_travel for s in carried if s.motor_travel > _WHOLE * PIECE]
    ratios = ratios or [s.link_travel / s.motor_travel for s in carried]
    return min(ratios, default=float("nan")), max(ratios, default=float("nan"))


def follows_by(strokes: list[Stroke]) -> float:
    """Motion of the link over that of the motor where the gear carried; NaN if it never did."""
    carried = [s for s in strokes if s.carried]
    motor = sum(s.motor_travel for s in carried)
    return sum(s.link_travel for s in carried) / motor if motor else float("nan")
