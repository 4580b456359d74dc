"""Errors of friction and rotor inertia caused by wrong bodies of a URDF: masses, centres, inertias.

With Y the regressor of the bodies, S S' the covariance of their usual errors, and z ~ N(0, 1),

    torque = friction x + Y S z                                     of each joint, filtered

The scale of gravity does not show a centre of mass that is displaced across it.
"""

import numpy as np
from scipy.linalg import block_diag

from common.arrays import Matrix, Vector
from estimator.model import Model
from identification.body_motion import filtered_regressor
from identification.body_rows import FEWEST, LASTING_S, REWEIGHTED, JointRows, Normal
from identification.log_intervals import Intervals
from identification.possible_bodies import off_center, possible, prior
from identification.regression import Regression, Solution

_FIRST = 3  # columns: Coulomb, viscous, rotor


def by_bodies(solved: list[Solution], found: Regression, rows: Intervals, model: Model) -> Matrix:
    """Standard errors (n, 3) of Coulomb friction, viscous friction and rotor inertia by wrong
    bodies: the change when bodies are fitted, too, and what the motion leaves uncertain of them.
    Zero for joints without enough rows."""
    parameters = model.parameters()
    massive = np.flatnonzero(parameters[:, 0] > 0.0)
    nominal = np.array([possible(row) for row in parameters[massive]])
    centers = block_diag(*(off_center(row)[:, :3] for row in nominal))
    usual = np.hstack([np.linalg.cholesky(np.linalg.inv(prior(nominal))), centers])
    bodies = filtered_regressor(rows, model)[0][:, :, massive]
    bodies = bodies.reshape(len(rows.dt), len(solved), -1) @ usual
    share = min(1.0, rows.period_s / LASTING_S)
    return np.array([_error(one, found, i, bodies[:, i], share) for i, one in enumerate(solved)])


def _error(one: Solution, found: Regression, i: int, bodies: Matrix, independent: float) -> Vector:
    """Standard errors (3,) of joint i, for bodies (N, b) scaled by their usual errors."""
    used = np.isfinite(one.errors)
    friction = np.hstack([found.columns[:, i, used], found.nuisance[:, i]])
    rows = JointRows(found.r_nl[:, i], friction, bodies, one.weight, one.weight)
    normal, z = Normal(rows, np.ones(len(bodies), dtype=np.bool_)), np.zeros(bodies.shape[1])
    if not used[:_FIRST].all() or normal.count <= FEWEST:
        return np.zeros(_FIRST)
    for _ in range(REWEIGHTED):
        share = independent / normal.variance(z)
        covariance = np.linalg.inv(np.eye(len(z)) + share * normal.square)
        z = share * covariance @ normal.product
    change = normal.ways()[:_FIRST]
    variance = np.square(change @ z) + np.einsum("ij,jk,ik->i", change, covariance, change)
    return np.asarray(np.sqrt(variance))
