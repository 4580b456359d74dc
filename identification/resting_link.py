"""Position of a link at rest, and the direction in which a person pushes it."""

import numpy as np

from common.arrays import Vector

_REST_S = 0.2
_STILL = 0.0005  # [rad]
MOVED = 0.001
"""Distance [rad] by which a link is clearly pushed: less than the play of most gears."""


def resting_samples(period_s: float) -> int:
    """Number of samples of a link at rest with which an observation begins."""
    return max(2, round(_REST_S / period_s))


def stands(positions: Vector, least: int) -> bool:
    """True for at least `least` positions (N,) [rad] of a link at rest."""
    return len(positions) >= least and float(np.ptp(positions)) < _STILL


def departure(seen: Vector, period_s: float) -> tuple[float, float]:
    """Position of a link at rest, and how far from there it is held [rad], from positions (N,)
    [rad] that begin at rest and end while it is held; 0 if it is not clearly to one side."""
    few = resting_samples(period_s)
    rest = float(np.median(seen[:few]))
    away = seen[-few:] - rest
    held = np.all(away > MOVED) or np.all(away < -MOVED)
    return rest, float(np.median(away)) if held else 0.0
