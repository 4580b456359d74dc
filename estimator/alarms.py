"""Alarms: the ticks in which a residual exceeds its level, and the levels without one. Pure
functions.

A residual alarms if |r| exceeds its threshold in force. The excess of the threshold over the
configured level, near rest or while something is unknown, is its raise. Where learning has lowered
the level, the share k of the configured one in force is recorded, too, and the level at which an
alarm begins follows for every tick:

    k(L) L = min(max(k C, k_least L), L)      L: another configured level instead of C
    alarm at L    if    |r| - (threshold - k C) > k(L) L

because the needed level, k C, does not depend on the configured one.
"""

import numpy as np

from common.arrays import Matrix, Vector
from estimator.thresholds import LEAST_SHARE


def excess(residual: Matrix, raised: Matrix) -> Matrix:
    """|r| beyond the raise (ticks, n) [Nm]: the lowest level without an alarm."""
    beyond: Matrix = np.maximum(np.abs(residual) - raised, 0.0)
    return beyond


def critical_level(
    residual: Matrix, threshold: Matrix, configured: Vector, share: Matrix | None = None
) -> Matrix:
    """Configured level (ticks, n) [Nm] below which each tick alarms; 0 where none would.

    residual, threshold in force (ticks, n), configured levels (n,) [Nm]; share: k (ticks, n), by
    default 1, as without learning.
    """
    if share is None:
        return excess(residual, threshold - configured)
    needed = share * configured
    beyond = excess(residual, threshold - needed)
    sunk = (share < 1.0) & (beyond > needed)
    return np.where(sunk, beyond / LEAST_SHARE, beyond)


def critical_collision(
    residual: Matrix, threshold: Matrix, configured: Vector, share: Matrix
) -> Matrix:
    """Collision level (ticks, n) [Nm] below which each tick alarms; 0 where none would. Arguments
    as above: all that the contact level in force has beyond k C is in the collision level, too.

    A level that grows with speed is the exception: k scales the growth of the contact level only,
    and (1 - k) of it is neglected here.
    """
    return excess(residual, threshold - share * configured)


def per_hour(count: float, seconds: float) -> float:
    """Rate per hour of `count` events in `seconds`; NaN if these are 0."""
    return 3600.0 * count / seconds if seconds > 0.0 else float("nan")
