"""Alarms of residuals beyond their levels, and levels that would have been quiet. Pure.

A residual alarms where |r| is beyond its threshold in force. Its excess over the configured level,
near rest or while something is unknown, is its raise. Where learning has sunk the level, the
share k of the configured one that was in force is known, too, and the level at which an alarm
begins follows for every tick:

    k(L) L = min(max(k C, k_least L), L)      L: another configured level instead of C
    alarm at L    if    |r| - (threshold - k C) > k(L) L

as the level that was needed, k C, does not depend on the configured one.
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

    residual and threshold in force (ticks, n), configured levels (n,) [Nm]; share: k (ticks, n), 1
    where it is left out, which is right where nothing is learned.
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
    as above: all that the contact level in force has beyond k C the collision level has, too.

    A level that grows with the speed is the exception: k counts for that part of the contact level
    alone, so that (1 - k) of it is left out here.
    """
    return excess(residual, threshold - share * configured)


def per_hour(count: float, seconds: float) -> float:
    """Rate of so many events in so many seconds; NaN in no time."""
    return 3600.0 * count / seconds if seconds > 0.0 else float("nan")
