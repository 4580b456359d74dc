"""Momentum increments, impulses, velocities and gap state in each interval of a log.

Alignment, model and motor position are those of the estimator's tick, so that parameters are
identified as they are used.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.link_velocity import SAMPLES, Alignment
from estimator.model import Model
from estimator.motor_position import MotorPosition
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission, coulomb_viscous, resting
from identification.borders import borders
from identification.motion_log import PAUSE_S, SHORTEST, MotionLog

Mask = NDArray[np.bool_]
Rows = NDArray[np.int64] | slice

_BOTH = (1.5, 3.0)  # range of phi [half-gaps] if it met both borders and kept its zero
_CARRIES = 0.05  # share of the largest torque
_SOFTEST = 0.005  # [rad/Nm]
_ALL = slice(None)
_WINDOW_S = 4.0  # of motion, in which an integrated theta drifts by less than a gap


@dataclass(frozen=True, slots=True)
class Intervals:
    """Intervals of a log, one per row; matrices (N, n), means of both ends unless stated."""

    time_s: Vector
    """(N,), of its end"""
    dt: Vector
    """(N,) [s]"""
    first: Mask
    """(N,) True for the first interval after missing samples"""
    inertial: Matrix
    """(Delta(M q_dot) - dt beta) / dt [Nm]: what moves the links, gravity included"""
    current: Matrix
    """[A]"""
    gravity: Matrix
    """g(q) [Nm]"""
    q: Matrix
    """[rad]"""
    q_dot: Matrix
    theta_dot: Matrix
    theta_ddot: Matrix
    """Delta theta_dot / dt [rad/s2]"""
    advance: Matrix
    """change of theta in the interval, integrated or measured [rad]"""
    measured: bool
    """whether `advance` was measured"""
    ends: Matrix
    """(N, 5, n) at the end: `Alignment.aligned`, theta 0 if it was not measured"""
    asked: Matrix
    """Acceleration that the drives were asked for: change of the setpoint that they adopted in it
    [rad/s2]; 0 if the log has no setpoints"""

    @property
    def period_s(self) -> float:
        """Median interval [s]."""
        return float(np.median(self.dt))


def intervals(log: MotionLog, model: Model, settings: EstimatorSettings) -> Intervals:
    """Intervals of a log: samples at common instants, their differences and means.

    Raises LogError if no stretch of the log is long enough.
    """
    parts = [
        _stretch(log.select(rows), model, settings)
        for rows in log.stretches()
        if rows.stop - rows.start >= SHORTEST
    ]
    if not parts:
        raise LogError(f"samples are missing throughout the log: no {SHORTEST} are consecutive")
    names = [f.name for f in fields(Intervals) if f.name != "measured"]
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Intervals(measured=parts[0].measured, **joined)


def _stretch(log: MotionLog, model: Model, settings: EstimatorSettings) -> Intervals:
    n, size, period = log.n, len(log.time_s), log.period_s
    alignment = Alignment(n, settings, period)
    position = log.motor_position if settings.motor_position == "measured" else None
    measured = position is not None
    if position is None:
        position = np.zeros_like(log.current)
    steps = np.diff(log.time_s, prepend=log.time_s[0] - period)
    setpoint = np.zeros_like(log.current) if log.setpoint is None else log.setpoint
    samples = np.stack([log.current, log.motor_velocity, position, log.link_position], axis=1)
    given, aligned = np.asarray(alignment.samples), np.asarray(alignment.aligned)
    # `Alignment.aligned`: q, q_dot, current, theta_dot, theta; then momentum, beta, gravity.
    ends = np.zeros((size, 8, n))
    for k in range(size):
        given[:] = samples[k]
        for i in range(n):
            alignment.push(i, steps[k])
        if k >= SAMPLES - 1:
            for i in range(n):
                alignment.align(i)
            ends[k, :5] = aligned
            ends[k, 5], ends[k, 6] = model.dynamics(ends[k, 0], ends[k, 1])
            ends[k, 7] = model.gravity(ends[k, 0])
    ends, dt = ends[SAMPLES - 1 :], steps[SAMPLES:]
    change, mean = np.diff(ends, axis=0), 0.5 * (ends[1:] + ends[:-1])
    span = dt[:, None]
    return Intervals(
        time_s=log.time_s[SAMPLES:] - alignment.delay_s,
        dt=dt,
        first=np.arange(len(dt)) == 0,
        inertial=change[:, 5] / span - mean[:, 6],
        current=mean[:, 2],
        gravity=mean[:, 7],
        q=mean[:, 0],
        q_dot=mean[:, 1],
        theta_dot=mean[:, 3],
        theta_ddot=change[:, 3] / span,
        advance=change[:, 4] if measured else span * mean[:, 3],
        measured=measured,
        ends=ends[1:, :5],
        # A setpoint sent after a SYNC acts at once or from the next one on, and shows one sample
        # later.
        asked=np.diff(setpoint, axis=0)[1:-1] / span,
    )


@dataclass(frozen=True, slots=True)
class Located:
    """Gap state of each joint in each interval, (N, n)."""

    gap: Mask
    """At both ends of the interval: the gear carried nothing"""
    unclear: Mask
    """Undecided: the gear may have carried, or not"""
    phi: Matrix
    """At the end [rad]"""
    late: Vector
    """Delay of each link encoder behind the motor's (n,) [s]; 0 if it does not show"""


def play(rows: Intervals, late: Vector) -> Vector:
    """Usual motion (n,) [rad] of link and rotor against each other within a few seconds: both
    borders of the gap, and encoder errors except the delays `late` (n,) [s]. Bending of the gear,
    in proportion to the torque that moves and holds the link, is excluded; the jump of a gap as
    that torque changes sign is not taken for bending."""
    theta = rows.ends[:, 4] if rows.measured else np.cumsum(rows.advance, axis=0)
    parts = _windows(rows)
    apart = _unbent(rows.ends[:, 0] - theta + late * rows.ends[:, 1], rows.inertial, parts)
    spans = [np.ptp(np.percentile(apart[part], [2.0, 98.0], axis=0), axis=0) for part in parts]
    return np.asarray(np.percentile(spans, 75.0, axis=0))


def _windows(rows: Intervals) -> list[NDArray[np.int64]]:
    """Rows of windows of about `_WINDOW_S`, in each of which theta has one zero: an integrated one
    loses it where a sample is missing, a measured one after a pause."""
    paused = np.diff(rows.time_s, prepend=rows.time_s[0]) > PAUSE_S
    lost = np.flatnonzero(paused if rows.measured else rows.first)
    return [
        part
        for own in np.split(np.arange(len(rows.dt)), lost)
        if len(own)
        for part in np.array_split(own, max(1, round(float(rows.dt[own].sum()) / _WINDOW_S)))
    ]


def _unbent(apart: Matrix, torque: Matrix, parts: Sequence[Rows]) -> Matrix:
    """apart (N, n) [rad] without the gears' bending by torque (N, n) [Nm], fitted in windows."""
    bend = [_compliance(a, t, parts) for a, t in zip(apart.T, torque.T, strict=True)]
    return apart + np.array(bend) * torque


def _compliance(apart: Vector, torque: Vector, parts: Sequence[Rows]) -> float:
    """Compliance of the gear [rad/Nm], from apart [rad] and torque (N,) [Nm] of windows in each of
    which theta has its own zero and drift."""
    sides = np.sign(torque) * (np.abs(torque) > _CARRIES * np.abs(torque).max())
    columns, levels = [], []
    for part in parts:
        values = np.stack([apart[part], -torque[part], -sides[part]], axis=1)
        count = len(values)
        own = np.stack([np.ones(count), np.arange(count) / count], axis=1)
        values -= own @ np.linalg.lstsq(own, values, rcond=None)[0]
        columns.append(values[:, 1:])
        levels.append(values[:, 0])
    found, *_ = np.linalg.lstsq(np.concatenate(columns), np.concatenate(levels), rcond=None)
    return float(np.clip(found[0], 0.0, _SOFTEST))


def locate(rows: Intervals, t: Transmission, settings: EstimatorSettings) -> Located:
    """Gap state of each interval, by phi itself if theta is measured and phi met both borders; else
    by the estimator's own logic (`MotorPosition`) with the friction and rotor of `t`, which may
    take long to find the middle of the gap of a joint that carries little."""
    gap, phi, torque = _judged(rows, t, settings)
    late = np.zeros(t.n)
    unclear = ~gap & (np.abs(phi) < 0.85 * t.half_gap)
    if rows.measured:
        # Whatever the encoders' zeros, the middle of the gap lies between its borders. Bending
        # moves these, further on the side that carries more; it is removed by the motor's torque,
        # as the model's masses may be wrong.
        apart = rows.ends[:, 0] - rows.ends[:, 4]
        low, high = np.percentile(_unbent(apart, torque, [_ALL]), [1.0, 99.0], axis=0)
        for i in range(t.n):
            alpha = float(t.half_gap[i])
            middle = 0.5 * float(low[i] + high[i])
            if found := borders(apart[:, i], torque[:, i], rows.ends[:, 1, i], alpha):
                middle, alpha, late[i] = found.middle, min(alpha, found.half_gap), found.late_s
            elif _BOTH[0] * alpha < high[i] - low[i] < _BOTH[1] * alpha:
                alpha = min(alpha, 0.5 * float(high[i] - low[i]))
            else:
                continue
            phi[:, i] = apart[:, i] + late[i] * rows.ends[:, 1, i] - middle
            free = np.abs(phi[:, i]) < alpha - max(0.05 * alpha, 0.0005)
            before = np.concatenate([[False], free[:-1]]) & ~rows.first
            gap[:, i], unclear[:, i] = free & before, free ^ before
    return Located(gap, unclear, phi, late)


def _judged(
    rows: Intervals, t: Transmission, settings: EstimatorSettings
) -> tuple[Mask, Matrix, Matrix]:
    """Gap state and phi by the motor position that the estimator would have tracked, and torque
    [Nm] that the motor transmits to the gear."""
    position = MotorPosition(t, settings.gap, rows.measured)
    engaged, theta = np.empty(rows.q.shape, dtype=np.bool_), np.empty_like(rows.q)
    rub = coulomb_viscous(t.motor_coulomb, t.motor_viscous, rows.theta_dot, t.sign_width)
    rotor = t.rotor_inertia * rows.theta_ddot
    q, q_dot, current, theta_dot, _ = np.moveaxis(rows.ends, 1, 0)
    rest, tau_M = resting(theta_dot), t.torque_constant * current
    transmitted = t.torque_constant * rows.current - rotor - rub
    motion = np.stack([q, q_dot, theta_dot, rest, tau_M, rows.advance, rotor, transmitted], axis=2)
    for k, moved in enumerate(motion.tolist()):
        for i in range(t.n):
            if rows.first[k]:
                position.start(i, q[k, i])
            engaged[k, i] = position.step(i, rows.dt[k], *moved[i])
        theta[k] = position.theta
    return ~engaged, q - theta, transmitted


def around(rows: Intervals, marked: Mask, seconds: float) -> Mask:
    """Rows (N,) within so many seconds of a marked one."""
    width = 2 * round(seconds / rows.period_s) + 1
    return np.convolve(marked, np.ones(width), mode="same") > 0.5


def memory(rows: Intervals, gain: float) -> float:
    """Share of its output that the filter (13) keeps from row to row: (2 - T K) / (2 + T K)."""
    TK = gain * rows.period_s
    return (2.0 - TK) / (2.0 + TK)


def low_pass(values: Matrix, rows: Intervals, gain: float) -> Matrix:
    """Rows (N, ...) [Nm] after the residual's filter (13), r_dot = K (values - r), started from the
    first value of each stretch. Everything that a regression compares is filtered alike."""
    back = memory(rows, gain)
    forward = 1.0 - back
    out = np.empty_like(values)
    edges = [*np.flatnonzero(rows.first).tolist(), len(values)]
    for a, b in itertools.pairwise(edges):
        start = back * values[None, a]
        out[a:b] = lfilter([forward], [1.0, -back], values[a:b], axis=0, zi=start)[0]
    return out
