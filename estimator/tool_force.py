"""Force at the tool that the joints feel, by direction.

A force F at the tool is J^T F at the joints, and is felt once that of one joint exceeds its level:

    |a_i . F| > 1 for one i, with a_i = J_i / level_i

What is not felt is therefore a polytope around zero. Its nearest face is the direction in which the
arm feels best; its furthest corner that in which it feels worst. Where it has no end, as along a
stretched arm, nothing is felt.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import numpy as np

from arrays import Matrix, Vector

UNFELT_N = 1000.0
"""[N]; what takes more to be felt counts as not felt: a hand is hurt by a tenth of it."""
JOINTS = 12
"""Joints that are looked at, those that feel most: more would take longer than there is between two
ticks, and can only lower the force that is felt."""

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class ToolSense:
    """Forces [N] that are felt, and the directions (3,) in which; each stands for its opposite."""

    least: float
    least_along: Vector
    most: float
    """at worst, within the directions that are felt at all"""
    most_along: Vector
    unfelt: Matrix
    """orthogonal directions in which nothing is felt, (0 to 3, 3)"""


def tool_sense(jacobian: Matrix, level: Vector) -> ToolSense:
    """Forces that are felt at the tool, for its jacobian (3, n) [m] and the levels (n,) [Nm] > 0,
    infinite where a joint feels nothing.

    Where no direction is felt, least and most are UNFELT_N.
    """
    a = (jacobian / level).T
    strength = np.linalg.norm(a, axis=1)
    a = a[np.argsort(-strength)[:JOINTS]]
    _, sizes, axes = np.linalg.svd(a, full_matrices=True)
    felt = int(np.count_nonzero((sizes * UNFELT_N > 1.0) & (sizes > _ROUNDING * sizes[0])))
    unfelt = axes[felt:]
    if felt == 0:
        return ToolSense(UNFELT_N, axes[0], UNFELT_N, axes[0], unfelt)
    # Within the directions that are felt, so that the polytope is bounded.
    inside = a @ axes[:felt].T
    corner = _furthest_corner(inside) @ axes[:felt]
    most = float(np.linalg.norm(corner))
    best = inside[0] @ axes[:felt]
    nearest = float(np.linalg.norm(best))
    return ToolSense(1.0 / nearest, best / nearest, most, corner / most, unfelt)


def _furthest_corner(a: Matrix) -> Vector:
    """Furthest corner of the polytope |a_i . F| <= 1; a (m, r) of rank r, its first row not 0."""
    m, r = a.shape
    sets, signs = _choices(m, r)
    faces = a[sets]  # (sets, r, r)
    # Faces that are parallel meet nowhere.
    volume = np.abs(np.linalg.det(faces))
    meet = volume > _ROUNDING * volume.max()
    corners = np.linalg.solve(faces[meet][:, None], signs[None, :, :, None])[..., 0].reshape(-1, r)
    # A corner of faces that are nearly parallel is as uncertain as that.
    beyond = np.maximum(np.abs(corners @ a.T).max(axis=1), 1.0)
    corners = corners / beyond[:, None]
    furthest: Vector = corners[np.argmax(np.linalg.norm(corners, axis=1))]
    return furthest


@cache
def _choices(m: int, r: int) -> tuple[np.ndarray, Matrix]:
    """Which r of m faces meet, and on which sides; the opposite corner is as far."""
    sets = np.array(list(combinations(range(m), r)))
    signs = np.array([(1.0, *others) for others in product((-1.0, 1.0), repeat=r - 1)])
    return sets, signs
