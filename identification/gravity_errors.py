"""Errors of gravity at the joints, over the poses that an arm may take."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.model import Model
from identification.body_rows import BodiesFit
from identification.possible_bodies import prior

_POSES = 200
_CARRIES = 2.0  # least ratio of gravity to its prior error, from which on its scale is meaningful


@dataclass(frozen=True, slots=True)
class GravityErrors:
    """Errors of gravity at each joint (n,) over poses within the limits."""

    share: Vector  # standard deviation after the fit, over that before
    before: Vector  # standard deviation before the fit [Nm]
    scale: Vector  # gravity found over the URDF's; 1 where that is small


def gravity_errors(
    model: Model,
    nominal: Matrix,
    massive: NDArray[np.int64],
    limits: tuple[Vector, Vector],
    fit: BodiesFit,
) -> GravityErrors:
    """Errors with the nominal parameters (k, 10) of the bodies `massive` (k,), and with the fitted
    ones; limits: lower and upper (n,) [rad]."""
    drawn = np.random.default_rng(0).uniform(*limits, (_POSES, model.n))
    none = np.zeros(model.n)
    Y = np.array([model.regressor(q, none, none)[:, massive] for q in drawn])
    Y = Y.reshape(_POSES, model.n, -1)

    def deviation(information: Matrix) -> Vector:
        covariance = np.linalg.inv(information)
        return np.asarray(np.sqrt(np.einsum("kij,jl,kil->i", Y, covariance, Y) / _POSES))

    before, after = deviation(prior(nominal)), deviation(fit.information)
    by_urdf, found = (Y @ values.ravel() for values in (nominal, fit.parameters))
    size = np.square(by_urdf).mean(axis=0)
    scale = (found * by_urdf).mean(axis=0) / np.maximum(size, 1e-12)
    scale = np.where(np.sqrt(size) > _CARRIES * before, scale, 1.0)
    return GravityErrors(after / np.maximum(before, 1e-12), before, scale)
