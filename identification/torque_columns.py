"""Currents of a log that are not those of its motion: exchanged between joints, or low-passed.

Each is fitted as x = s tau + c sign(v) + d v + B a + b to a part of a log, and tested on the rest.
Undetected, they would appear as wrong torque constants, masses and friction.
"""

import itertools
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.friction_verdict import unexcited
from identification.log_intervals import Intervals, intervals, low_pass
from identification.motion_log import MotionLog
from identification.regression import HELD_OUT

_ROWS: Final = 20_000  # rows of a log that are used
_GAIN: Final = 30.0  # of the filter on both sides of a fit [1/s]
_SLOW: Final = 0.05  # of the velocity, beyond which friction has its sign
_LAGS_S: Final = (0.02, 0.05, 0.1, 0.2)  # of first-order low-passes
_LONG_S, _SHOWN = 0.04, 1.5  # [s], periods; a longer lag is neither a drive's filter nor sampling
_CLEARLY, _LATER = 0.5, 0.45  # factor on the squared residuals: if exchanged, after a lag
_FITS: Final = 0.2  # of the variance; motion that differs from the first part leaves more


def refuse_other_torques(log: MotionLog, model: Model, settings: EstimatorSettings) -> None:
    """Raise LogError if the currents of two joints fit clearly better when exchanged, or those of
    most joints after a lag."""
    rows = intervals(log.select(slice(0, _ROWS)), model, settings)
    there = np.ptp(rows.current, axis=0) > 0.0
    moved = [i for i in range(log.n) if there[i] and not unexcited(rows.theta_dot[:, i])]
    columns = [torque_parts(rows, i) for i in moved]
    x = low_pass(rows.current[:, moved], rows, _GAIN)
    if not moved:
        return
    left = np.array([[_left(low_pass(c, rows, _GAIN), each) for each in x.T] for c in columns])
    bound = np.minimum(_CLEARLY * left.diagonal(), _FITS)
    for i, j in itertools.combinations(range(len(moved)), 2):
        if left[i, j] < bound[j] and left[j, i] < bound[i]:
            raise LogError(f"currents (or torques) of {log.joints[moved[i]]} and "
                           f"{log.joints[moved[j]]} fit the motion of each other: exchange "
                           "these two columns")  # fmt: skip
    lagged = [
        [_left(low_pass(low_pass(c, rows, 1.0 / lag), rows, _GAIN), each)
         for c, each in zip(columns, x.T, strict=True)] for lag in _LAGS_S
    ]  # fmt: skip
    least, lag = np.min(lagged, axis=0), np.median(np.array(_LAGS_S)[np.argmin(lagged, axis=0)])
    better = float(np.median(least / left.diagonal()))
    if lag > max(_LONG_S, _SHOWN * rows.period_s) and better < _LATER and np.median(least) < _FITS:
        raise LogError(f"currents lag behind the motion as after a low-pass of about "
                       f"{1e3 * lag:.0f} ms: log them unfiltered")  # fmt: skip


def torque_parts(rows: Intervals, i: int) -> Matrix:
    """Columns (N, 5) of a motor's torque: tau, sign(v), v, a and 1 of the equation above."""
    v = rows.theta_dot[:, i]
    slow = _SLOW * float(np.percentile(np.abs(v), 90.0)) or 1.0
    return np.stack([rows.inertial[:, i], np.tanh(v / slow), v, rows.theta_ddot[:, i],
                     np.ones_like(v)], axis=1)  # fmt: skip


def _left(columns: Matrix, x: Vector) -> float:
    """Mean square of the last part of x (N,) that columns (N, 5) leave, over the variance of x."""
    k = round((1.0 - HELD_OUT) * len(x))
    found, *_ = np.linalg.lstsq(columns[:k], x[:k], rcond=None)
    return float(np.square(x[k:] - columns[k:] @ found).mean() / max(np.var(x), 1e-12))
