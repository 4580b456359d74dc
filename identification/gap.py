"""Half-gap alpha of one joint, from whichever side of its gear moves.

- The motor stands, a person moves the link: phi rests at one border, then at the other
  (`plateaus`, the paper's V-A).
- The link is clamped, the motor pushes with slow ramps of torque: the dead zone of torque over phi
  (`ramps`).
- The motor turns slowly to and fro while friction or gravity holds its link (`strokes`): without a
  hand, and the method of `contactd identify gap`.
- Both move: phi rests at either border, and leads in proportion to speed if one encoder is late
  (`gap_in_motion`), which shows the skew between the encoders.
"""

from dataclasses import replace

import numpy as np

from common.arrays import Vector
from identification.gap_in_motion import from_motion
from identification.gap_result import (
    ONE_BORDER,
    SMALLEST,
    GapResult,
    GapVerdict,
    Limit,
    refused,
    spread,
)
from identification.motion_log import PAUSE_S, MotionLog
from identification.plateaus import from_plateaus
from identification.ramps import from_ramps
from identification.stroke_samples import stroking
from identification.strokes import from_strokes

_WIDEST = 0.5  # [rad], the most that a configuration accepts
_PARTLY = 0.6
_ALIKE = 1.1  # range of phi over all sittings relative to one, if the zeros are unchanged
_SHAKEN = 0.05  # [rad]; a motor that is to stand still moves less
_WALKS = 2.0  # Kuiper: range of integrated noise without its mean, in 99 of 100 logs


def identify_gap(
    log: MotionLog, joint: int, torque_constant: float, gear: float = 0.0, *,
    by_hand: bool = False, stroked: bool = False,
) -> GapResult:  # fmt: skip
    """Half-gap of one joint by the method that fits what moved in the log, which may contain
    several sittings; `by_hand` even if the motor gave way, or `stroked` even if it turned unevenly.
    gear: turns of the motor per turn of the link, 0 if unknown."""
    found = _found(log, joint, torque_constant, gear, by_hand=by_hand, stroked=stroked)
    if found.usable:
        widest = Limit("alpha", 1e3 * found.half_gap, 1e3 * _WIDEST, "mrad",
                       "positions in another unit than rad")  # fmt: skip
        found = refused(found, GapVerdict.UNCLEAR, [widest])
    if log.motor_position is not None:
        return found
    if found.limit is not None and found.limit.cause == ONE_BORDER:
        about = ("; or motor_velocity is the change of link_position, as of one encoder: log the "
                 "motor's own position (`motor_position`)")  # fmt: skip
        found = replace(found, reason=found.reason + about)
    # No encoder of the motor was read: a harmonic of its turn is not that encoder's error.
    of_link = tuple(one for one in found.harmonics if one.encoder == "link")
    return replace(found, harmonics=of_link)


def _found(
    log: MotionLog, joint: int, torque_constant: float, gear: float, *, by_hand: bool, stroked: bool
) -> GapResult:
    log = _spanning(log, joint)
    q, theta = positions(log, joint)
    moved_q, moved_theta = spread(q), spread(theta)
    name = log.joints[joint]
    if max(moved_q, moved_theta) < SMALLEST:
        about = f"link and motor stayed within {1e3 * max(moved_q, moved_theta):.2g} mrad"
        return GapResult(joint=name, verdict=GapVerdict.NO_MOTION, reason=about)
    if log.motor_position is not None and float(np.ptp(q - theta)) < 1e-5 * moved_q:
        about = "link and motor position are the same signal"
        return GapResult(joint=name, verdict=GapVerdict.NO_LINK_ENCODER, reason=about)
    if by_hand:
        return _by_hand(log, joint, torque_constant, q, theta)
    if stroked:
        return by_strokes(log, joint, torque_constant, gear)
    return _by_what_moved(log, joint, torque_constant, gear, q, theta)


def _by_what_moved(
    log: MotionLog, joint: int, torque_constant: float, gear: float, q: Vector, theta: Vector
) -> GapResult:
    name, moved_q, moved_theta = log.joints[joint], spread(q), spread(theta)
    if stroking(log.motor_velocity[:, joint]):
        return by_strokes(log, joint, torque_constant, gear)
    torque = torque_constant * log.current[:, joint]
    if moved_q < 0.05 * moved_theta:
        return _as_seen(from_ramps(name, log.time_s, q - theta, torque), log)
    between = spread(q - theta)
    if moved_theta > _SHAKEN and moved_theta > 3.0 * between:
        velocity = log.motor_velocity[:, joint]
        return from_motion(name, log.time_s, q, theta, velocity, gear=gear, torque=torque)
    return _by_hand(log, joint, torque_constant, q, theta)


def _as_seen(found: GapResult, log: MotionLog) -> GapResult:
    """Half-gap from ramps, which a log of velocities may hide."""
    if log.motor_position is not None or found.verdict is GapVerdict.CLEAR:
        return found
    about = ("a motor may cross a gap between two samples of its velocity: log its position "
             "(`motor_position`)")  # fmt: skip
    return replace(found, verdict=GapVerdict.UNCLEAR, half_gap=np.nan,
                   reason=f"{found.reason}; {about}")  # fmt: skip


def by_strokes(log: MotionLog, joint: int, torque_constant: float, gear: float = 0.0) -> GapResult:
    """Half-gap of one joint whose motor turned to and fro; gear: as for `identify_gap`."""
    q, theta = positions(log, joint)
    velocity, torque = log.motor_velocity[:, joint], torque_constant * log.current[:, joint]
    return from_strokes(log.joints[joint], log.time_s, q, theta, velocity, torque, gear=gear,
                        integrated=log.motor_position is None)  # fmt: skip


def _by_hand(
    log: MotionLog, joint: int, torque_constant: float, q: Vector, theta: Vector
) -> GapResult:
    """Half-gap from a hand. A motor that is moved by it gives none, unless its measured position
    and its torque account for that."""
    moved_theta, between = spread(theta), spread(q - theta)
    name, torque = log.joints[joint], torque_constant * log.current[:, joint]
    mean_velocity = float(log.motor_velocity[:, joint].mean())
    found = from_plateaus(name, log.time_s, q, theta, mean_velocity, torque)
    accounted = log.motor_position is not None and np.isfinite(found.compliance)
    if accounted or not moved_theta > 0.6 * between > 1.2 * SMALLEST:
        return found
    about = f"by {1e3 * moved_theta:.3g} mrad, the link against it by {1e3 * between:.3g} mrad"
    guess = found.half_gap if np.isfinite(found.half_gap) else found.estimate
    return GapResult(joint=name, verdict=GapVerdict.MOTOR_MOVED, reason=about, estimate=guess)


def _spanning(log: MotionLog, joint: int) -> MotionLog:
    """Log without sittings of another zero in which phi spans far less than in others: those at one
    border only have no middle."""
    q, theta = positions(log, joint)
    phi, sittings = q - theta, log.stretches(PAUSE_S)
    if _one_zero(log, q, theta):
        return log
    spans, there = [spread(phi[rows]) for rows in sittings], np.zeros(len(phi), dtype=np.bool_)
    for rows, span in zip(sittings, spans, strict=True):
        there[rows] = span > _PARTLY * max(spans)
    return log.select(there)


def _one_zero(log: MotionLog, q: Vector, theta: Vector) -> bool:
    """True if the zeros are the same in all sittings: phi spans no more over all than in one, and
    the motor moves; one that stands, as for a hand, may have been moved in between."""
    sittings, phi = log.stretches(PAUSE_S), q - theta
    if len(sittings) == 1 or log.motor_position is None:
        return len(sittings) == 1
    moves, each = (max(spread(x[rows]) for rows in sittings) for x in (theta, phi))
    return moves > _SHAKEN and spread(phi) < _ALIKE * each


def positions(log: MotionLog, joint: int) -> tuple[Vector, Vector]:
    """Positions (N,) [rad] of link and motor. If a zero differs after a pause, each sitting is
    shifted to begin with the motor at zero, and with the middle of its own phi there, so that
    sittings can be compared."""
    q, theta = log.link_position[:, joint].copy(), np.empty_like(log.time_s)
    sittings = log.stretches(PAUSE_S)
    for rows in sittings:
        theta[rows] = _theta(log, rows, joint)
    if _one_zero(log, q, theta):
        return q, theta
    for rows in sittings:
        low, high = np.percentile(q[rows] - theta[rows], [2.0, 98.0])
        q[rows] -= theta[rows.start] + 0.5 * (low + high)
        theta[rows] -= theta[rows.start]
    return q, theta


def _theta(log: MotionLog, rows: slice, joint: int) -> Vector:
    """Motor position, measured or integrated. If the motor stood, the mean velocity is subtracted,
    as an uncalibrated bias adds 15 mrad in 40 s; motion within integrated noise becomes 0."""
    if log.motor_position is not None:
        return log.motor_position[rows, joint]
    velocity, time_s = log.motor_velocity[rows, joint], log.time_s[rows]
    steps = np.diff(time_s, prepend=time_s[0])
    middle = 0.5 * (velocity + np.concatenate([velocity[:1], velocity[:-1]]))
    theta: Vector = np.cumsum(middle * steps)
    without_mean = theta - velocity.mean() * (time_s - time_s[0])
    moved = spread(without_mean)
    noise = 1.4826 * float(np.median(np.abs(np.diff(velocity)))) / np.sqrt(2.0)
    if moved < _WALKS * noise * np.sqrt(np.square(steps).sum()):
        return np.zeros_like(theta)
    return without_mean if moved < _SHAKEN else theta
