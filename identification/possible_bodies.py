"""Least squares over the parameters of physically possible bodies, with a prior at those of the
URDF.

The prior is the log-determinant divergence of pseudo-inertias (Lee, Wensing, Park 2020),

    D(P, P0) = tr(P0^-1 P) - log det(P0^-1 P) - 4                       of each body,

which is convex in the parameters, does not depend on units or frames, and grows without bound
towards an impossible body. So it is both the prior and the constraint P > 0: Newton's method solves
it, and no semidefinite program is needed (decision 0054).
"""

from itertools import combinations_with_replacement

import numpy as np

from common.arrays import Matrix, Vector
from estimator.body_inertia import PARAMETERS, parameters_of, pseudo_inertia

USUAL = 0.2
"""Usual relative error of a URDF's bodies: one standard deviation."""
PENALTY = 0.25 / USUAL**2
"""Weight of D: a mass that is off by that, with its tensor, costs what one standard deviation does
(D is 4 x^2 / 2 for a relative error x)."""
_OFF_CENTER = 0.02
"""Usual error of a URDF's centres of mass along each axis [m]: one standard deviation. The prior of
a slender body has less."""
_THINNEST = 0.002  # [m], least radius of gyration, for the URDF's point masses and rods
_STEPS = 300
_DONE = 1e-6  # of the sum of squares, whose unit is one standard deviation
_SHORTEST = 1e-6
_BASIS = np.array([pseudo_inertia(row) for row in np.eye(PARAMETERS)])


def possible(parameters: Vector) -> Vector:
    """Ten parameters (10,) of the possible body nearest to that of the URDF: points, rods and
    tensors that were rounded to zero get a small size."""
    P = pseudo_inertia(parameters)
    m, c = P[3, 3], P[:3, 3] / P[3, 3]
    values, axes = np.linalg.eigh(P[:3, :3] - m * np.outer(c, c))
    about_center = (axes * np.maximum(values, m * _THINNEST**2)) @ axes.T
    P[:3, :3] = about_center + m * np.outer(c, c)
    return parameters_of(P)


def regularised_fit(square: Matrix, product: Vector, nominal: Matrix) -> tuple[Matrix, Matrix]:
    """Parameters (k, 10) that minimise d' H d / 2 - b' d + PENALTY sum D, d the difference from
    nominal (k, 10), `possible` ones; and the Hessian there, (10 k, 10 k): the inverse of their
    covariance.

    square: H (10 k, 10 k), product: b (10 k,), of the least squares in standard deviations.
    """
    inverse = _inverted(nominal)
    found = nominal.copy()
    value = _value(found, nominal, square, product, inverse)
    for _ in range(_STEPS):
        gradient, hessian = _derivatives(found, nominal, square, product, inverse)
        step = -np.linalg.solve(hessian, gradient)
        falls = float(-gradient @ step)
        length, change = 1.0, step.reshape(nominal.shape)
        tried = _value(found + change, nominal, square, product, inverse)
        while tried > value - 0.1 * length * falls and length > _SHORTEST:
            length *= 0.5
            tried = _value(found + length * change, nominal, square, product, inverse)
        if falls < _DONE or length <= _SHORTEST:  # converged, to rounding
            break
        found, value = found + length * change, tried
    _, hessian = _derivatives(found, nominal, square, product, inverse)
    return found, hessian


def prior(nominal: Matrix) -> Matrix:
    """Inverse covariance (10 k, 10 k) before any motion."""
    k = nominal.size
    none = np.zeros((k, k))
    inverse = _inverted(nominal)
    return _derivatives(nominal, nominal, none, none[0], inverse)[1]


def off_center(parameters: Vector) -> Matrix:
    """Changes of ten parameters (10, 9) by a centre that is as far off along each axis as that of a
    URDF usually is, and by the squares and products of these distances."""
    P, shifts = pseudo_inertia(parameters), np.zeros((3, 4, 4))
    shifts[[0, 1, 2], [0, 1, 2], 3] = _OFF_CENTER
    changes = [shift @ P + P @ shift.T for shift in shifts]
    changes += [a @ P @ b.T + b @ P @ a.T for a, b in combinations_with_replacement(shifts, 2)]
    return np.stack([parameters_of(change) for change in changes], axis=1)


def _inverted(parameters: Matrix) -> Matrix:
    """Inverse (k, 4, 4) of each pseudo-inertia."""
    return np.linalg.inv(np.array([pseudo_inertia(row) for row in parameters], dtype=np.float64))


def _value(at: Matrix, nominal: Matrix, square: Matrix, product: Vector, inverse: Matrix) -> float:
    d = (at - nominal).ravel()
    value = float(0.5 * d @ square @ d - product @ d)
    for row, known in zip(at, inverse, strict=True):
        P = pseudo_inertia(row)
        try:
            np.linalg.cholesky(P)
        except np.linalg.LinAlgError:
            return float("inf")
        relative = known @ P
        value += PENALTY * float(np.trace(relative) - np.linalg.slogdet(relative)[1] - 4.0)
    return value


def _derivatives(
    at: Matrix, nominal: Matrix, square: Matrix, product: Vector, inverse: Matrix
) -> tuple[Vector, Matrix]:
    gradient = square @ (at - nominal).ravel() - product
    hessian = square.copy()
    for i, (row, known) in enumerate(zip(at, inverse, strict=True)):
        own = slice(PARAMETERS * i, PARAMETERS * (i + 1))
        here = np.linalg.inv(pseudo_inertia(row))
        gradient[own] += PENALTY * np.einsum("jab,ba->j", _BASIS, known - here)
        turned = here @ _BASIS
        hessian[own, own] += PENALTY * np.einsum("jab,kba->jk", turned, turned)
    return gradient, hessian
