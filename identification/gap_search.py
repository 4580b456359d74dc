"""Search for the gap of one joint without a hand: the strokes that its motor makes next, and where.

A generator requests strokes and is sent their log, so that a live arm and simulations of many arms
run the same search. It begins with few strokes through the gap guessed by the configuration, widens
them while the link does not follow, moves to where gravity really changes sign if the URDF was
wrong about that, and ends with strokes that show the gap as precisely as possible.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from identification.gap import by_strokes, positions
from identification.gap_result import GapResult, GapVerdict
from identification.motion_log import MotionLog
from identification.stroke_samples import balance
from identification.strokes import STROKES

SPEED = 0.03
"""Largest speed of the motor at the link [rad/s]."""
_SLOW = 0.015  # [rad/s], for gaps that else are crossed within a second
_SLOWEST, _PERIOD_S = 0.007, 0.01  # [rad/s] for longer periods, between which it moves on
_NARROW = 0.015  # [rad] of half-gap
_TRIAL_STROKES = 2
_BEYOND = 0.03  # [rad] beyond the gap, so that the link follows
WIDEST = 0.13
"""Largest half-gap that is searched for [rad]."""
_TURNS = 1.1  # of the motor while it carries its link, to show its encoder's errors
FURTHEST = 0.15
"""Largest distance that the link is carried for that [rad]."""
_NEAR = 0.01  # [rad] from the balance; strokes need not be closer
_MOVES = 3
_AGAIN = 2  # factor on the number of strokes, once, if they leave alpha unclear
_OFF = 0.3  # [rad], largest distance of the balance from the URDF's


@dataclass(frozen=True, slots=True)
class Strokes:
    """Strokes of one motor, to and fro about a pose."""

    about: float
    """Link position of that pose [rad]"""
    travel: float
    """distance of the motor from end to end [rad]"""
    speed: float
    """[rad/s]"""
    count: int


Search = Generator[Strokes, MotionLog, GapResult]
Gravity = Callable[[Vector], float]
"""Gravity torque of one joint by the URDF [Nm], in a pose (n,) [rad]."""


def search(
    joint: int,
    torque_constant: float,
    gear: float,
    guess: float,
    gravity: Gravity,
    start: float,
    room: tuple[float, float],
    period_s: float = _PERIOD_S,
) -> Search:
    """Search for the gap of `joint`. guess: initial half-gap [rad]; start: link position [rad] at
    which gravity changes sign by the URDF; room: range of link positions [rad] to stay within;
    period_s: sampling period of the logs [s]; a long one slows the motor down. Returns the
    result."""
    half, about, moves = max(guess, 0.002), start, 0
    fastest = float(np.clip(SPEED * _PERIOD_S / period_s, _SLOWEST, SPEED))

    def strokes(travel: float, speed: float, count: int) -> Strokes:
        travel = min(travel, room[1] - room[0])
        inside = np.clip(about, room[0] + 0.5 * travel, room[1] - 0.5 * travel)
        return Strokes(float(inside), travel, speed, count)

    while True:
        log = yield strokes(2.0 * half + _BEYOND, fastest, _TRIAL_STROKES)
        scouted = by_strokes(log, joint, torque_constant, gear)
        there = _balance(log, joint, torque_constant, gravity)
        reachable = abs(there - start) < _OFF and room[0] < there < room[1]
        moved = reachable and abs(there - about) > _NEAR and moves < _MOVES
        if moved:
            about, moves = there, moves + 1
        if scouted.verdict not in (GapVerdict.TOO_SHORT, GapVerdict.ONE_BORDER):
            break
        if half >= WIDEST and not moved:
            return scouted
        half = min(2.0 * half, WIDEST)
    known = scouted.half_gap if np.isfinite(scouted.half_gap) else scouted.estimate
    half = known if np.isfinite(known) else half
    carried = min(max(_TURNS * 2.0 * np.pi / gear, _BEYOND), FURTHEST)
    count = STROKES
    while True:
        speed = min(_SLOW, fastest) if half < _NARROW else fastest
        log = yield strokes(2.0 * half + carried, speed, count)
        found = by_strokes(log, joint, torque_constant, gear)
        if found.verdict is GapVerdict.TOO_SHORT and half < WIDEST:
            half = min(1.5 * half + 0.5 * _BEYOND, WIDEST)
        elif found.verdict is GapVerdict.UNCLEAR and count == STROKES:
            count *= _AGAIN
        else:
            return found


def _balance(log: MotionLog, joint: int, torque_constant: float, gravity: Gravity) -> float:
    """Link position [rad] at which the load that the motor really holds changes sign, by the slope
    of the URDF's gravity; NaN if gravity is negligible."""
    pose, step = log.link_position.mean(axis=0), np.zeros(log.n)
    step[joint] = 0.01
    slope = (gravity(pose + step) - gravity(pose - step)) / 0.02
    q, theta = positions(log, joint)
    torque = torque_constant * log.current[:, joint]
    return balance(log.time_s, q, theta, log.motor_velocity[:, joint], torque, slope)
