"""Coupled joints, which one motor turns together, as in the wrist of an industrial arm.

If the motor of one joint turns its neighbour, too, the friction of each shows in the torque of
both, and values identified for either alone are wrong, however good the fit. The residuals show it:
that of each joint follows the motion of the other.
"""

import numpy as np

from common.arrays import Matrix, Vector
from estimator.transmission import smooth_sign
from identification.log_intervals import Intervals, low_pass

_EXPLAINED = 0.12
"""Share of both residuals that the other's motion explains: 0.24 on a TX40's wrist, at most 0.05
between its other joints, 0.03 on simulated arms."""
_SEEN = 0.02  # of Coulomb friction: less is noise


def coupled(
    left: Matrix, weight: Matrix, coulomb: Vector, rows: Intervals, sign_width: float, gain: float
) -> dict[int, int]:
    """Joints that are coupled with a neighbour, and that neighbour.

    left (N, n) [Nm]: residual that the joints' own friction does not explain; weight (N, n) of each
    row; coulomb (n,) [Nm]; gain [1/s] of the filter that `left` passed.
    """
    found: dict[int, int] = {}
    n = left.shape[1]
    own = [_friction(rows.theta_dot[:, i], rows, sign_width, gain) for i in range(n)]
    for i in range(n - 1):
        j = i + 1
        orders = ((i, j), (j, i))
        if all(_follows(left[:, a], weight[:, a], coulomb[a], own[a], own[b]) for a, b in orders):
            found[i], found[j] = j, i
    return found


def _friction(theta_dot: Vector, rows: Intervals, sign_width: float, gain: float) -> Matrix:
    """Columns (N, 2) of Coulomb and viscous friction of one motion, filtered like r_nl."""
    columns = np.stack([smooth_sign(theta_dot, sign_width), theta_dot], axis=1)
    return low_pass(columns, rows, gain)


def _follows(left: Vector, weight: Vector, coulomb: float, own: Matrix, others: Matrix) -> bool:
    """True if another joint's motion explains a residual that its own does not."""
    before = _unexplained(left, weight, own)
    after = _unexplained(left, weight, np.hstack([own, others]))
    size = np.sqrt(max(before - after, 0.0) / max(float(weight @ weight), 1e-12))
    return after < (1.0 - _EXPLAINED) * before and bool(size > _SEEN * coulomb)


def _unexplained(left: Vector, weight: Vector, columns: Matrix) -> float:
    """Weighted sum of squares that columns (N, k) do not explain [Nm2]."""
    X, y = columns * weight[:, None], left * weight
    solution, *_ = np.linalg.lstsq(X, y, rcond=None)
    return float(np.square(y - X @ solution).sum())
