"""Touches by a person in motion that is meant to be contact-free: torque beyond friction."""

import numpy as np

from common.arrays import Vector
from identification.log_intervals import Intervals, Mask, around

SUSTAINED_S = 0.1
"""Least duration of a touch [s]; impacts at the borders of a gap are shorter."""
AROUND_S = 0.5
"""Time around a touch that is discarded with it."""
_FAR = 30.0  # times the usual scatter; contact-free motion of 80 joints reached 25
_SHARE = 0.3  # of Coulomb friction, the least that counts as a touch


def touches(rows: Intervals, left: Vector, weight: Vector, coulomb: float) -> Mask:
    """Rows (N,) in which one joint was touched. left (N,) [Nm]: residual of its fit; weight (N,) of
    each row; coulomb: its friction [Nm]."""
    counts = weight > 0.5
    if not counts.any():
        return counts
    scatter = 1.4826 * float(np.median(np.abs(left[counts])))
    width = max(1, round(SUSTAINED_S / rows.period_s))
    window = np.ones(width)
    enough = np.convolve(weight, window, mode="same")
    mean = np.convolve(left * weight, window, mode="same") / np.maximum(enough, 0.5 * width)
    return np.asarray(np.abs(mean) > max(_FAR * scatter, _SHARE * coulomb))


def near(rows: Intervals, touched: Mask) -> Mask:
    """Rows (N,) excluded because they are close to a touch of any joint, touched (N, n)."""
    return around(rows, np.asarray(touched.any(axis=1)), AROUND_S)
