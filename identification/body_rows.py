"""Least squares for the bodies of an arm: rows of each joint, with its friction eliminated.

With d the difference of the parameters from nominal ones, x friction and rotor of a joint,

    torque = bodies d + friction x                                          (N,) [Nm], filtered

x does not enter the rows of other joints, and is projected out of the normal equations in d. It is
unbounded: if drives step their setpoints, the rotor's column takes what their currents miss.
"""

from dataclasses import dataclass, replace

import numpy as np

from common.arrays import Matrix, Vector
from identification.log_intervals import Mask
from identification.possible_bodies import regularised_fit

FEWEST = 50.0
"""Sum of weights below which a joint's rows carry no information."""
CORRELATED_S = 0.1
"""Correlation time of the fit's errors [s], by the filter and by what no column explains."""
LASTING_S = 1.5
"""The same for bending gears, encoders and late columns: about as long as a stroke."""
REWEIGHTED = 4
_SMALLEST = 0.1
"""Share of the median error below which all rows have the same weight"""


@dataclass(frozen=True, slots=True)
class JointRows:
    """Rows of one joint."""

    torque: Vector
    """(N,) [Nm] that nominal bodies leave, to be explained by friction and rotor, too"""
    friction: Matrix
    """(N, f): Coulomb, viscous, rotor, and further columns"""
    bodies: Matrix
    """(N, 10 k)"""
    clean: Vector
    """(N,) 0 to 1, weight of each row regardless of touches"""
    weight: Vector
    """(N,) the same, 0 near a touch"""
    late: float = 0.0
    """Delay of its link encoder behind the motor's [s]; 0 if it does not show"""

    def left(self, d: Vector, x: Vector) -> Vector:
        """Torque (N,) [Nm] that is not explained."""
        return self.torque - self.bodies @ d - self.friction @ x

    def rms(self, d: Vector, x: Vector, chosen: Mask) -> float:
        """Root mean square of the unexplained torque in the chosen rows [Nm]; NaN of too few."""
        w2 = np.square(self.weight[chosen])
        if w2.sum() < FEWEST:
            return float("nan")
        return float(np.sqrt(w2 @ np.square(self.left(d, x)[chosen]) / w2.sum()))


@dataclass(frozen=True, slots=True)
class BodiesFit:
    """Fit of the bodies to all joints."""

    parameters: Matrix
    """(k, 10)"""
    difference: Vector
    """(10 k,) from the nominal ones"""
    information: Matrix
    """(10 k, 10 k) inverse covariance, including the prior"""
    of_motion: Matrix
    """the same without the prior"""
    friction: list[Vector]
    """of each joint, by the columns of its rows"""


class Normal:
    """Normal equations of one joint in d, over the chosen rows."""

    def __init__(self, rows: JointRows, chosen: Mask) -> None:
        w = rows.weight * chosen
        self.count = float(np.square(w).sum())
        X, y, B = w[:, None] * rows.friction, w * rows.torque, w[:, None] * rows.bodies
        size = np.linalg.norm(X, axis=0)
        scale = 1.0 / np.where(size > 1e-9, size, np.inf)  # a column of zeros is left out
        X = X * scale
        self._inverse, self._scale = np.linalg.pinv(X.T @ X, rcond=1e-12), scale
        self._Xy, self._XB = X.T @ y, X.T @ B
        self.square = B.T @ B - self._XB.T @ self._inverse @ self._XB
        self.product = B.T @ y - self._XB.T @ self._inverse @ self._Xy
        self._total = float(y @ y - self._Xy @ self._inverse @ self._Xy)

    def variance(self, d: Vector) -> float:
        """Variance of the error at d [Nm2]."""
        total = self._total - 2.0 * self.product @ d + d @ self.square @ d
        return max(float(total) / self.count, 1e-12)

    def friction(self, d: Vector) -> Vector:
        """Friction x for a given d."""
        x: Vector = self._scale * (self._inverse @ (self._Xy - self._XB @ d))
        return x

    def ways(self) -> Matrix:
        """Derivative of x by d (f, 10 k)."""
        change: Matrix = -self._scale[:, None] * (self._inverse @ self._XB)
        return change


def fitted(joints: list[JointRows], chosen: Mask, nominal: Matrix, period_s: float) -> BodiesFit:
    """Bodies by the chosen rows (N,), one every `period_s`, with a prior at nominal (k, 10)."""
    normals = [Normal(rows, chosen) for rows in joints]
    d = np.zeros(nominal.size)
    for _ in range(REWEIGHTED):
        square, product = summed(normals, d, period_s)
        parameters, information = regularised_fit(square, product, nominal)
        d = (parameters - nominal).ravel()
    friction = [normal.friction(d) for normal in normals]
    return BodiesFit(parameters, d, information, square, friction)


def unbent(
    joints: list[JointRows], chosen: Mask, nominal: Matrix, period_s: float
) -> tuple[Vector, list[Vector]]:
    """Difference and friction of a fit of least absolute deviations (by reweighting): unlike that
    of least squares it does not bend towards a touch, which would then hide."""
    fit = fitted(joints, chosen, nominal, period_s)
    for _ in range(REWEIGHTED):
        steep = []
        for one, x in zip(joints, fit.friction, strict=True):
            left = np.abs(one.left(fit.difference, x))
            least = _SMALLEST * float(np.median(left)) + 1e-12
            steep.append(replace(one, weight=one.weight * np.sqrt(least / np.maximum(left, least))))
        fit = fitted(steep, chosen, nominal, period_s)
    return fit.difference, fit.friction


def summed(normals: list[Normal], d: Vector, period_s: float) -> tuple[Matrix, Vector]:
    """Normal equations of all joints with enough rows, each scaled by its error at d."""
    independent = min(1.0, period_s / CORRELATED_S)
    square, product = np.zeros((d.size, d.size)), np.zeros(d.size)
    for normal in normals:
        if normal.count > FEWEST:
            share = independent / normal.variance(d)
            square += share * normal.square
            product += share * normal.product
    return square, product


def without_bodies(joints: list[JointRows], chosen: Mask) -> list[Vector]:
    """Friction of each joint with nominal bodies."""
    return [Normal(r, chosen).friction(np.zeros(r.bodies.shape[1])) for r in joints]
