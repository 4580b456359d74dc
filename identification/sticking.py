"""Stiction share of a joint's Coulomb friction: the part that near rest keeps its value of the last
motion instead of following the velocity, as smooth friction does. See `estimator.stiction`.

    r_nl + tau_mu + B theta_ddot = -stiction K_theta_s (z - s(theta_dot))                  engaged
"""

import numpy as np

from common.arrays import Matrix, Vector
from estimator.stiction import Stiction
from estimator.transmission import CREEP, smooth_sign
from identification.log_intervals import Intervals

_PRESLIDING = 0.0015  # [rad]
SURE = 0.1
"""Standard error above which the share counts as unknown."""


def held(rows: Intervals, sign_width: float) -> tuple[Matrix, Matrix]:
    """z - s(theta_dot), means of both ends of each interval, and the uncertainty of z; (N, n).

    This is the friction that the estimator assumes to be held near rest, for a stiction and
    K_theta_s of 1, and a single pre-sliding distance.
    """
    n = rows.q.shape[1]
    operator = Stiction(n, (_PRESLIDING, _PRESLIDING), np.ones(n), np.ones(n))
    z, unknown = np.empty_like(rows.q), np.empty_like(rows.q)
    for k, moved in enumerate(_displacement(rows).tolist()):
        for i in range(n):
            if rows.first[k]:
                operator.restart(i)
            before = operator.held[i]
            operator.step(i, moved[i], 0.0)
            z[k, i] = 0.5 * (before + operator.held[i])
            unknown[k, i] = operator.unknown[i]
    return z - smooth_sign(rows.theta_dot, sign_width), unknown


def _displacement(rows: Intervals) -> Matrix:
    """Displacement of the rotors in each interval (N, n) [rad]. A bias, integrated, would move them
    at rest: where both creep, rotor and link count as one."""
    if rows.measured:
        return rows.advance
    clearly = np.maximum(np.abs(rows.theta_dot), np.abs(rows.q_dot)) > CREEP
    return np.where(clearly, rows.advance, rows.dt[:, None] * rows.q_dot)


def sticking_share(
    left: Vector, held: Vector, weight: Vector, time_s: Vector
) -> tuple[float, float]:
    """Share that explains `left` (N,) [Nm] by `held` (N,) [Nm], within 0 ... 1, and its standard
    error from blocks of a second; NaN and infinite if nothing was held."""
    x, y = weight * held, weight * left
    square = float(x @ x)
    if square < 1e-12:
        return float("nan"), float("inf")
    share = float(x @ y) / square
    blocks = np.unique(time_s // 1.0, return_inverse=True)[1]
    sums = np.bincount(blocks, weights=x * (y - share * x))
    return min(max(share, 0.0), 1.0), float(np.sqrt(sums @ sums)) / square
