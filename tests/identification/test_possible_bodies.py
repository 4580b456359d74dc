"""Fits of bodies: only of those that can exist, and near the URDF where nothing shows more."""

import numpy as np
import pinocchio as pin
import pytest

from estimator.body_inertia import parameters_of, point_mass, pseudo_inertia
from identification.possible_bodies import PENALTY, possible, prior, regularised_fit

BALL = pin.Inertia.FromSphere(2.0, 0.1)
OFF_CENTER = pin.Inertia(1.0, np.array([0.05, 0.0, -0.1]), np.diag([0.01, 0.012, 0.008]))
NOMINAL = np.array([BALL.toDynamicParameters(), OFF_CENTER.toDynamicParameters()])


def smallest(parameters: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(pseudo_inertia(parameters))[0])


def test_without_motion_the_bodies_are_those_of_the_urdf() -> None:
    found, information = regularised_fit(np.zeros((20, 20)), np.zeros(20), NOMINAL)
    assert found == pytest.approx(NOMINAL)
    assert information == pytest.approx(prior(NOMINAL))


def test_what_is_measured_clearly_is_found_and_the_rest_stays() -> None:
    """A first moment of the second body, to a millionth; the first has nothing to do with it."""
    square = np.zeros((20, 20))
    square[11, 11] = 1e12
    found, _ = regularised_fit(square, square[:, 11] * 0.02, NOMINAL)
    assert found[1, 1] == pytest.approx(NOMINAL[1, 1] + 0.02, abs=1e-6)
    assert found[0] == pytest.approx(NOMINAL[0])
    assert smallest(found[1]) > 0.0


@pytest.mark.parametrize("wanted", [-1.0, -10.0, -1000.0])
def test_no_measurement_makes_a_body_that_cannot_exist(wanted: float) -> None:
    """A mass below zero, and a moment of inertia, both asked for strongly."""
    for k in (0, 4, 16):
        square = np.zeros((20, 20))
        square[k, k] = 1e6
        product = square[:, k] * (wanted - NOMINAL.ravel()[k])
        found, _ = regularised_fit(square, product, NOMINAL)
        assert min(smallest(row) for row in found) > 0.0
        assert found.ravel()[k] < 0.2 * NOMINAL.ravel()[k]


def test_a_fifth_of_the_mass_is_one_standard_deviation() -> None:
    """Prior of a body that is scaled as a whole."""
    hessian = prior(NOMINAL[:1])
    assert float(NOMINAL[0] @ hessian @ NOMINAL[0]) == pytest.approx(1.0 / 0.2**2, rel=0.05)


@pytest.mark.parametrize("radius", [0.0, 0.01])
def test_points_and_rods_of_a_urdf_get_a_little_size(radius: float) -> None:
    place = np.array([0.1, 0.0, 0.2])
    rod = np.diag([radius**2, radius**2, 0.0])
    body = pin.Inertia(0.5, place, 0.5 * rod).toDynamicParameters()
    made = possible(body)
    assert smallest(made) > 0.0
    assert made[:4] == pytest.approx(body[:4])
    assert made[4:] == pytest.approx(body[4:], abs=2e-5)
    whole = BALL.toDynamicParameters()
    assert possible(whole) == pytest.approx(whole)
    assert parameters_of(pseudo_inertia(point_mass(1.0, place)))[0] == 1.0


@pytest.mark.parametrize("strength", [1.0, 1e3, 1e6])
def test_the_answer_is_the_least_of_fit_and_pull(strength: float) -> None:
    """By the definition of both, against steps in every direction."""
    rng = np.random.default_rng(5)
    Y = rng.standard_normal((40, 20))
    square = strength * Y.T @ Y
    product = square @ (rng.uniform(-2.0, 0.5, 20) * NOMINAL.ravel())
    found, information = regularised_fit(square, product, NOMINAL)

    def value(parameters: np.ndarray) -> float:
        d = (parameters - NOMINAL).ravel()
        whole = 0.5 * d @ square @ d - product @ d
        for row, known in zip(parameters, NOMINAL, strict=True):
            relative = np.linalg.solve(pseudo_inertia(known), pseudo_inertia(row))
            whole += PENALTY * (np.trace(relative) - np.log(np.linalg.det(relative)) - 4.0)
        return float(whole)

    steps = np.linalg.inv(np.linalg.cholesky(information)).T  # columns of one standard deviation
    for step in steps.T.reshape(20, 2, 10):
        for way in (0.03, -0.03):
            assert value(found + way * step) > value(found)
