"""Regressors of the fits of bodies: torques per unit of each parameter, and the remaining torque,
joint by joint.

With the model's parameters pi_0, the regressor Y of the links' torques, and friction and rotor as
in `regression`,

    r_nl + Y (pi - pi_0) = -tau_mu - B theta_ddot                                       filtered

so that torques, alignment and gap are those of the estimator.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission, resting
from identification.body_rows import JointRows
from identification.log_intervals import Intervals, Mask, intervals, locate, low_pass, memory
from identification.motion_log import MotionLog
from identification.regression import GAIN, regression, weights_of
from identification.sticking import held
from identification.touches import near, touches

OFFSET = 5
"""Column of `JointRows.friction` for a constant offset of the current."""


_MORE = 2
_NOISE = 0.005  # share of squared acceleration; beyond, inertias come out too small, masses large


@dataclass(frozen=True, slots=True)
class BodyMotion:
    """Motion of a log in intervals; matrices (N, n), filtered where a fit compares them."""

    rows: Intervals
    regressor: Matrix
    """Y (N, n, n, 10), filtered; the last axes are joint and parameter of what it moves"""
    sticking: Matrix
    """z - s of `sticking.held`"""
    cut: Mask
    """current at its limit"""
    more: int
    """number of further passes of the filter, for coarse encoders"""

    def touched(self, joints: list[JointRows], d: Vector, friction: list[Vector]) -> Mask:
        """Rows (N, n) in which something acted that the fit does not explain."""
        found = [
            touches(self.rows, one.left(d, x), one.clean, max(float(x[0]), 0.0))
            for one, x in zip(joints, friction, strict=True)
        ]
        return np.stack(found, axis=1)


def body_motion(
    log: MotionLog,
    model: Model,
    settings: EstimatorSettings,
    max_current: Vector,
    sign_width: float,
    shortest_s: float,
) -> BodyMotion:
    """Motion of a log; max_current (n,) [A]. Raises LogError if it is shorter than `shortest_s`."""
    if log.measured_s + log.period_s < shortest_s - 1e-6:
        raise LogError(
            f"the log is too short: {log.measured_s:.1f} s, at least {shortest_s:g} s of motion"
        )
    rows = intervals(log, model, settings)
    Y, q_ddot = filtered_regressor(rows, model)
    sticking, _ = held(rows, sign_width)
    cut = np.abs(rows.current) > 0.98 * max_current
    more = _MORE * (float(np.median(_noise(rows, q_ddot))) > _NOISE)
    return BodyMotion(rows, _smooth(Y, rows, more), sticking, cut, more)


def filtered_regressor(rows: Intervals, model: Model) -> tuple[NDArray[np.float64], Matrix]:
    """Regressor Y (N, n, n, 10), filtered, and the links' accelerations (N, n) [rad/s2]."""
    q_ddot = np.diff(rows.ends[:, 1], axis=0, prepend=rows.ends[:1, 1]) / rows.dt[:, None]
    q_ddot[rows.first] = 0.0
    moving = zip(rows.q, rows.q_dot, q_ddot, strict=True)
    return low_pass(np.array([model.regressor(*each) for each in moving]), rows, GAIN), q_ddot


def _noise(rows: Intervals, q_ddot: Matrix) -> Vector:
    """Share of noise in the square of the filtered accelerations (n,), from white noise of the
    positions as their third differences show it."""
    within = ~(rows.first[1:-2] | rows.first[2:-1] | rows.first[3:])
    of_position = np.diff(rows.q, 3, axis=0)[within].var(axis=0) / 20.0
    back = float(np.median(memory(rows, GAIN)))
    pulse = np.zeros(256)
    pulse[:3] = np.array([1.0, -2.0, 1.0]) / rows.period_s**2
    answer = lfilter([1.0 - back], [1.0, -back], pulse)
    total = np.square(low_pass(q_ddot, rows, GAIN)).mean(axis=0)
    return np.asarray(of_position * np.square(answer).sum() / np.maximum(total, 1e-12))


def _smooth(values: Matrix, rows: Intervals, more: int) -> Matrix:
    """Rows (N, ...) after further passes of the filter: the resolution of coarse encoders is noise
    of the regressor, whose square would make inertias too small."""
    for _ in range(more):
        values = low_pass(values, rows, GAIN)
    return values


def rows_of_joints(
    motion: BodyMotion,
    bodies: Matrix,
    t: Transmission,
    settings: EstimatorSettings,
    touched: Mask,
    offset: Mask,
) -> list[JointRows]:
    """Rows of each joint, for parameters with the regressor bodies (N, n, p). The friction of `t`
    serves to locate the gap; rows near those `touched` (N, n) do not count; joints of `offset` (n,)
    may have a constant offset of the current."""
    rows = motion.rows
    where = locate(rows, t, settings)
    found = regression(rows, t, where, motion.sticking)
    spoilt = near(rows, touched)
    # Friction, rotor, the link's friction in the gap, an offset of the current, and what is held
    # after a reversal.
    beside = found.nuisance[:, :, 1:] * np.stack([offset, np.ones_like(offset)], axis=1)
    friction = -_smooth(
        np.concatenate([found.columns[:, :, :5], beside], axis=2), rows, motion.more
    )
    torque = -_smooth(found.r_nl, rows, motion.more)
    joints = []
    for i in range(len(t.joints)):
        rest = resting(rows.theta_dot[:, i])
        clean = weights_of(rows, i, where, motion.cut[:, i], rest)
        joints.append(
            JointRows(
                torque[:, i], friction[:, i], bodies[:, i], clean, clean * ~spoilt,
                late=float(where.late[i]),
            )
        )  # fmt: skip
    return joints


def with_friction(t: Transmission, friction: list[Vector]) -> Transmission:
    """Transmission with fitted sums of friction and rotor inertias; the sums are divided between
    motor and link as before."""
    found = np.maximum(np.array([x[:3] for x in friction]), 0.0)
    new = {"rotor_inertia": found[:, 2]}
    for k, kind in enumerate(("coulomb", "viscous")):
        link, motor = getattr(t, f"link_{kind}"), getattr(t, f"motor_{kind}")
        share = link / np.where(link + motor > 0.0, link + motor, 1.0)
        new[f"link_{kind}"] = share * found[:, k]
        new[f"motor_{kind}"] = (1.0 - share) * found[:, k]
    return replace(t, **new)
