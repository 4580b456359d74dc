"""Known force at the tool: the error of its estimate, and torque constants that explain it.

A residual is K_c times a current: if a constant is k times the configured one, a force f at the
tool shows r_i = (J^T f)_i / k_i, and up to e_i of it is friction that holds the motor. Over all
poses but the last,

    k_i = sum tau_i r_i / sum r_i^2,    within  sum |r_i| e_i / sum r_i^2,    tau = J^T f

and the last one, the held-out witness, must show the force better with them. If one is off by more
than MOST, the mass or its place is more likely wrong, and none is proposed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector

MOST: Final = 0.1
"""Largest correction, and largest error of a constant that is accepted, as a share."""
_USUAL_N: Final = 100.0  # prior standard deviation of a force
_LEVER: Final = 2.0  # least ratio of a joint's torque to its friction


@dataclass(frozen=True, slots=True)
class HeldPose:
    """One pose: the known force (3,) [N] along the root's axes, what it added to the residuals (n,)
    [Nm], the friction by which that is uncertain (n,) [Nm], and J of the tool point (3, n)."""

    force: Vector
    added: Vector
    friction: Vector
    J: Matrix

    def error_N(self, factor: Vector) -> float:
        """Error of the force along directions that the joints show, from residuals times `factor`
        (n,) [N]."""
        weight = 1.0 / np.square(self.friction)
        S = (self.J * weight) @ self.J.T
        axes, _, _ = np.linalg.svd(S)
        seen = np.sqrt(np.diag(axes.T @ np.linalg.inv(S + np.eye(3) / _USUAL_N**2) @ axes))
        found = np.linalg.solve(
            S + np.eye(3) / _USUAL_N**2, (self.J * weight) @ (factor * self.added)
        )
        off = axes.T @ (found - self.force)
        return float(np.linalg.norm(off[seen < 0.5 * np.linalg.norm(self.force)]))


@dataclass(frozen=True, slots=True)
class Correction:
    """Factors of the torque constants (n,) with their bounds, the proposed ones (1: none), those
    too large for a constant, and the witness's error with the present and the proposed ones [N]."""

    factor: Vector
    bound: Vector
    proposed: Vector
    beyond: NDArray[np.bool_]
    before_N: float
    after_N: float

    @property
    def witnessed(self) -> bool:
        """True if the held-out error drops by more than a tenth."""
        return self.after_N < 0.9 * self.before_N


def correct(poses: Sequence[HeldPose]) -> Correction:
    """Correction from two or more poses; the last is held out. A proposal is the value within the
    bounds that is nearest to the present constant; none is made for a joint that shows less than
    its friction, nor any if one would exceed MOST."""
    r = np.array([pose.added for pose in poses[:-1]])
    tau = np.array([pose.J.T @ pose.force for pose in poses[:-1]])
    e = np.array([pose.friction for pose in poses[:-1]])
    shows = np.where(np.abs(tau) > _LEVER * e, 1.0, 0.0)
    squares = np.sum(shows * r * r, axis=0)
    known = squares > 0.0
    over = np.where(known, squares, 1.0)
    factor = np.where(known, np.sum(shows * tau * r, axis=0) / over, 1.0)
    bound = np.where(known, np.sum(shows * np.abs(r) * e, axis=0) / over, np.inf)
    nearest = np.clip(1.0, factor - bound, factor + bound)
    beyond = np.abs(nearest - 1.0) > MOST
    proposed = np.ones(len(factor)) if beyond.any() else nearest
    witness = poses[-1]
    before, after = witness.error_N(np.ones(len(factor))), witness.error_N(proposed)
    return Correction(factor, bound, proposed, beyond, before, after)
