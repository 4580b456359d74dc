"""Joints that one motor turns together: the coupled wrist of an industrial arm.

Where the motor of one joint turns its neighbour, too, the friction of each shows in the torque of
both, and values identified of either alone are wrong, however well they fit. It shows in the
residuals: that of each joint follows the other's motion.
"""

import numpy as np

from common.arrays import Matrix, Vector
from estimator.transmission import smooth_sign
from identification.log_intervals import Intervals, low_pass

_EXPLAINED = 0.12
"""Share of both remainders that the other's motion explains: 0.24 on a TX40's wrist, at most 0.05
between its other joints, 0.03 on simulated arms."""
_SEEN = 0.02  # of Coulomb friction: less is noise


def coupled(
    left: Matrix, weight: Matrix, coulomb: Vector, rows: Intervals, sign_width: float, gain: float
) -> dict[int, int]:
    """Joints that are coupled with a neighbour, and that neighbour.

    left (N, n) [Nm]: what the joints' own friction does not explain; weight (N, n): how much each
    row counts; coulomb (n,) [Nm]; gain [1/s] of the filter that `left` passed.
    """
    found: dict[int, int] = {}
    n = left.shape[1]
    own = [_friction(rows.theta_dot[:, i], rows, sign_width, gain) for i in range(n)]
    for i in range(n - 1):
        j = i + 1
        ways = ((i, j), (j, i))
        if all(_follows(left[:, a], weight[:, a], coulomb[a], own[a], own[b]) for a, b in ways):
            found[i], found[j] = j, i
    return found


def _friction(theta_dot: Vector, rows: Intervals, sign_width: float, gain: float) -> Matrix:
    """Columns (N, 2) of Coulomb and viscous friction of one motion, as r_nl is filtered."""
    columns = np.stack([smooth_sign(theta_dot, sign_width), theta_dot], axis=1)
    return low_pass(columns, rows, gain)


def _follows(left: Vector, weight: Vector, coulomb: float, own: Matrix, others: Matrix) -> bool:
    """True where another joint's motion explains a residual that its own does not."""
    before = _unexplained(left, weight, own)
    after = _unexplained(left, weight, np.hstack([own, others]))
    size = np.sqrt(max(before - after, 0.0) / max(float(weight @ weight), 1e-12))
    return after < (1.0 - _EXPLAINED) * before and bool(size > _SEEN * coulomb)


def _unexplained(left: Vector, weight: Vector, columns: Matrix) -> float:
    """Weighted sum of squares that columns (N, k) leave [Nm2]."""
    X, y = columns * weight[:, None], left * weight
    solution, *_ = np.linalg.lstsq(X, y, rcond=None)
    return float(np.square(y - X @ solution).sum())
