"""Both borders of a gap in motion, by the torque that the motor transmits.

At a border, the one that the torque pushes against,

    q - theta = middle - alpha sign(torque) - compliance torque - lateness q_dot

so that neither bending of the gear nor a late link encoder is taken for play, whatever masses the
model has. Rotor friction that the torque still contains acts like a late encoder, but not in
proportion to the speed: lateness is what remains.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector

Mask = NDArray[np.bool_]

_CARRIES = 0.1  # share of the largest torque from which on the gear carries
_RARE = 0.03  # share of the rows; a border met more rarely is not trusted
_FEWEST = 200
_AS_WIDE, _GIVE = 0.2, 0.0005  # of the half-gap, and [rad]; a larger difference is not mere bending
_CLEAR = 0.15  # largest scatter of the rows, over the half-gap
_SOFTEST = 0.005  # [rad/Nm]
_BETTER = 0.7  # factor on the scatter from which on an encoder counts as late
_LEAST_S = 0.0005  # of lateness; less comes from interpolation
_FAR = 4.0


@dataclass(frozen=True, slots=True)
class Borders:
    """Borders of one joint."""

    middle: float
    """of q - theta [rad]"""
    half_gap: float
    """[rad]"""
    late_s: float
    """of the link encoder behind the motor's"""


def borders(apart: Vector, torque: Vector, q_dot: Vector, half_gap: float) -> Borders | None:
    """Borders from apart (N,) = q - theta [rad], torque (N,) [Nm] and q_dot (N,); None if they do
    not show, or are not those of this half-gap."""
    carries = np.abs(torque) > _CARRIES * np.abs(torque).max()
    side = np.sign(torque)
    used = carries & (np.abs(np.gradient(apart)) <= np.median(np.abs(np.gradient(apart))))
    rarer = min(np.count_nonzero(used & (side > 0.0)), np.count_nonzero(used & (side < 0.0)))
    if used.sum() < _FEWEST or rarer < _RARE * used.sum():
        return None
    columns = np.stack([np.ones_like(apart), -side, -torque, -np.sign(q_dot), -q_dot], axis=1)
    found, scatter = _fitted(columns[:, :3], apart, used, carries)
    _, scatter_rubs = _fitted(columns[:, :4], apart, used, carries)
    late, scatter_late = _fitted(columns, apart, used, carries)
    if scatter_late < _BETTER * min(scatter, scatter_rubs) and abs(late[4]) > _LEAST_S:
        found, scatter = late, scatter_late
    if (
        abs(found[1] - half_gap) > _AS_WIDE * half_gap + _GIVE
        or scatter > _CLEAR * half_gap + _GIVE
        or abs(found[2]) > _SOFTEST
    ):
        return None
    return Borders(float(found[0]), float(found[1]), float(found[4]) if len(found) > 4 else 0.0)


def _fitted(columns: Matrix, apart: Vector, used: Mask, tested: Mask) -> tuple[Vector, float]:
    """Coefficients by the used rows, fitted again without outliers; scatter of the tested rows."""
    found, *_ = np.linalg.lstsq(columns[used], apart[used], rcond=None)
    left = np.abs(apart - columns @ found)
    near = used & (left <= _FAR * np.median(left[used]) + 1e-9)
    found, *_ = np.linalg.lstsq(columns[near], apart[near], rcond=None)
    left = np.abs(apart - columns @ found)
    return found, 1.4826 * float(np.median(left[tested]))
