"""Skew of a log's columns: velocities and currents that are late, or early, against positions.

A velocity is the derivative of its position, so v(t + d) = p'(t), and to first order v - p' = -d
p''. The delay of currents is the one that fits the links' torques, friction and rotors best; it is
common to all joints, as a message carries them together.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import savgol_filter

from common.arrays import Matrix, Vector
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.log_intervals import Intervals, intervals, low_pass
from identification.motion_log import MotionLog
from identification.torque_columns import torque_parts

LONGEST_S: Final = 0.015
"""Largest skew: a larger one is not a skew."""
_ROWS: Final = 20_000  # rows of a log that are used
_SMOOTH_S: Final = 0.03  # half a window
_ROUNDS: Final = 3
_STEP_S: Final = 0.001
_GAIN: Final = 30.0  # of the filter on both sides of a fit [1/s]
_LEAST_S: Final = (0.0015, 0.002)  # least correction of a velocity, of a current
_LEAST: Final = 1e-3  # least acceleration that shows a skew [rad/s2]
_BETTER: Final = 0.97  # factor on the squared residuals, of the median joint, for a correction


@dataclass(frozen=True, slots=True)
class Skew:
    """Delays behind the positions [s], negative if early; 0 if none shows."""

    velocity: Vector
    """(n,) of the motors'"""
    current: float

    def notes(self, joints: tuple[str, ...]) -> tuple[str, ...]:
        """Message about the skew found, or none."""
        late = [f"motor_velocity of {joint} {1e3 * by:+.1f} ms"
                for joint, by in zip(joints, self.velocity, strict=True) if by]  # fmt: skip
        late += [f"currents {1e3 * self.current:+.1f} ms"] if self.current else []
        return (f"columns lag behind the positions, which was corrected: {', '.join(late)}",
               ) if late else ()  # fmt: skip


def without_skew(
    log: MotionLog, model: Model, settings: EstimatorSettings
) -> tuple[MotionLog, Skew]:
    """The log with its columns at the times of its positions, and the skew that was corrected."""
    seen = log.select(slice(0, _ROWS))
    skew = Skew(np.array([_of_velocity(seen, i) for i in range(log.n)]), 0.0)
    rows = intervals(_shifted(seen, skew), model, settings)
    skew = replace(skew, current=_of_currents(rows))
    return _shifted(log, skew), skew


def _shifted(log: MotionLog, skew: Skew) -> MotionLog:
    def at(values: Matrix, late: Vector) -> Matrix:
        moved = values.copy()
        for rows in log.stretches():
            t = log.time_s[rows]
            for i in np.flatnonzero(late):
                moved[rows, i] = np.interp(t + late[i], t, values[rows, i])
        return moved

    return replace(
        log,
        motor_velocity=at(log.motor_velocity, skew.velocity),
        current=at(log.current, np.full(log.n, skew.current)),
    )


def _of_velocity(log: MotionLog, i: int) -> float:
    """Delay [s] of the velocity of joint i."""
    position = log.link_position if log.motor_position is None else log.motor_position
    period, late = log.period_s, 0.0
    width = max(5, 2 * round(_SMOOTH_S / period) + 1)
    parts = [rows for rows in log.stretches() if rows.stop - rows.start > 3 * width]
    for _ in range(_ROUNDS):
        difference, change, squares = 0.0, 0.0, 0.0
        for rows in parts:
            t, p = log.time_s[rows], position[rows, i]
            v = savgol_filter(np.interp(t + late, t, log.motor_velocity[rows, i]), width, 2)
            apart = (v - savgol_filter(p, width, 2, 1, period))[width:-width]
            curve = savgol_filter(p, width, 2, 2, period)[width:-width]
            difference -= float(apart @ curve)
            change += float(curve @ curve)
            squares += float(apart @ apart)
        if not change > len(log.time_s) * _LEAST**2:
            return 0.0
        late += difference / change
        if abs(late) > LONGEST_S:
            return 0.0
    sure = abs(late) > max(_LEAST_S[0], 3.0 * np.sqrt(width * squares / change / len(log.time_s)))
    return late if sure else 0.0


def _of_currents(rows: Intervals) -> float:
    """Delay [s] of the currents of all joints."""
    tried = np.arange(-LONGEST_S, LONGEST_S + 0.5 * _STEP_S, _STEP_S)
    found, gains = [], []
    for i in range(rows.current.shape[1]):
        basis, *_ = np.linalg.svd(low_pass(torque_parts(rows, i), rows, _GAIN), full_matrices=False)
        shifts = np.stack([np.interp(rows.time_s + d, rows.time_s, rows.current[:, i])
                           for d in tried], axis=1)  # fmt: skip
        signals = low_pass(shifts, rows, _GAIN)
        left = np.square(signals - basis @ (basis.T @ signals)).sum(axis=0)
        k = int(np.argmin(left))
        if 0 < k < len(tried) - 1:
            a, b, c = left[k - 1 : k + 2]
            curve = a - 2.0 * b + c
            found.append(float(tried[k]) + (0.5 * _STEP_S * (a - c) / curve if curve else 0.0))
            gains.append(float(b / max(left[len(tried) // 2], 1e-300)))
    late = float(np.median(found)) if found else 0.0
    return late if abs(late) > _LEAST_S[1] and np.median(gains) < _BETTER else 0.0
