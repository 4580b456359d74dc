"""Smallest detectable force at the tool, by direction.

A force F at the tool causes joint torques J^T F, and is detected once that of one joint exceeds its
level:

    |a_i . F| > 1 for one i, with a_i = J_i / level_i

The undetected forces are therefore a polytope around zero. Its nearest face is in the direction of
best detection, its farthest vertex in that of worst. Where it is unbounded, as along a stretched
arm, nothing is detected.
"""

from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import numpy as np

from common.arrays import Matrix, Vector

UNDETECTED_N = 1000.0
"""Force above which a direction counts as undetectable [N]: a tenth of it hurts a hand."""
JOINTS = 12
"""Number of joints used, the most sensitive ones: more would exceed the time between two ticks, and
could only lower the detectable force."""

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class ToolSense:
    """Smallest detectable forces [N] and their directions (3,), each up to its sign."""

    least: float
    least_along: Vector
    most: float
    """in the worst of the detectable directions"""
    most_along: Vector
    undetected: Matrix
    """orthogonal directions without any detection, (0 to 3, 3)"""


def tool_sense(jacobian: Matrix, level: Vector) -> ToolSense:
    """Detectable forces at the tool, from its Jacobian (3, n) [m] and the levels (n,) [Nm] > 0,
    infinite for a joint that senses nothing.

    If no direction is detectable, least and most are UNDETECTED_N.
    """
    a = (jacobian / level).T
    strength = np.linalg.norm(a, axis=1)
    a = a[np.argsort(-strength)[:JOINTS]]
    _, sizes, axes = np.linalg.svd(a, full_matrices=True)
    seen = int(np.count_nonzero((sizes * UNDETECTED_N > 1.0) & (sizes > _ROUNDING * sizes[0])))
    undetected = axes[seen:]
    if seen == 0:
        return ToolSense(UNDETECTED_N, axes[0], UNDETECTED_N, axes[0], undetected)
    # Within the detectable directions, so that the polytope is bounded.
    inside = a @ axes[:seen].T
    corner = _furthest_corner(inside) @ axes[:seen]
    most = float(np.linalg.norm(corner))
    best = inside[0] @ axes[:seen]
    nearest = float(np.linalg.norm(best))
    return ToolSense(1.0 / nearest, best / nearest, most, corner / most, undetected)


def _furthest_corner(a: Matrix) -> Vector:
    """Farthest vertex of the polytope |a_i . F| <= 1; a (m, r) of rank r, its first row not 0."""
    m, r = a.shape
    sets, signs = _choices(m, r)
    faces = a[sets]  # (sets, r, r)
    # Parallel faces do not intersect.
    volume = np.abs(np.linalg.det(faces))
    meet = volume > _ROUNDING * volume.max()
    corners = np.linalg.solve(faces[meet][:, None], signs[None, :, :, None])[..., 0].reshape(-1, r)
    # A vertex of nearly parallel faces is inaccurate: it is scaled back into the polytope.
    beyond = np.maximum(np.abs(corners @ a.T).max(axis=1), 1.0)
    corners = corners / beyond[:, None]
    furthest: Vector = corners[np.argmax(np.linalg.norm(corners, axis=1))]
    return furthest


@cache
def _choices(m: int, r: int) -> tuple[np.ndarray, Matrix]:
    """Choices of r of m faces that intersect, and their signs; the opposite vertex is as far."""
    sets = np.array(list(combinations(range(m), r)))
    signs = np.array([(1.0, *others) for others in product((-1.0, 1.0), repeat=r - 1)])
    return sets, signs
