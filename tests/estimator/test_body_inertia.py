"""Bodies as figures of a URDF, as ten parameters, as pseudo-inertias, and in the model."""

import numpy as np
import pinocchio as pin
import pytest

from bench.rigs.lockstep import ROMEO
from common.errors import ModelError
from daemon.config.load import load_robot
from estimator.body_inertia import (
    BodyInertia,
    parameters_of,
    point_mass,
    pseudo_inertia,
    refuse_impossible,
)
from estimator.model import Model

ROBOT = load_robot(ROMEO)
NAMES = ROBOT.configuration.joint_names


def random_body(seed: int) -> pin.Inertia:
    rng = np.random.default_rng(seed)
    places, masses = rng.normal(0.1, 0.3, (20, 3)), rng.uniform(0.01, 0.2, 20)
    parts = [
        pin.Inertia(float(m), x, np.zeros((3, 3))) for m, x in zip(masses, places, strict=True)
    ]
    return sum(parts[1:], parts[0])


@pytest.mark.parametrize("seed", range(5))
def test_a_body_keeps_its_figures_on_every_way(seed: int) -> None:
    body = random_body(seed)
    parameters = body.toDynamicParameters()
    ours = BodyInertia.of(parameters)
    assert ours.mass == pytest.approx(body.mass, rel=1e-5)
    assert ours.com == pytest.approx(body.lever.tolist(), rel=1e-5)
    assert ours.tensor() == pytest.approx(body.inertia, rel=1e-4, abs=1e-7)
    assert parameters_of(pseudo_inertia(parameters)) == pytest.approx(parameters)
    assert np.linalg.eigvalsh(pseudo_inertia(parameters))[0] > 0.0


def test_a_point_mass_is_that_of_pinocchio() -> None:
    place = np.array([0.1, -0.2, 0.3])
    point = pin.Inertia(0.7, place, np.zeros((3, 3)))
    assert point_mass(0.7, place) == pytest.approx(point.toDynamicParameters())


@pytest.mark.parametrize(
    ("inertia", "possible"),
    [
        ((1.0, 0.0, 0.0, 1.0, 0.0, 1.9), True),
        ((1.0, 0.0, 0.0, 1.0, 0.0, 2.1), False),  # more than the two others together
        ((1.0, 0.0, 0.0, 1.0, 0.0, -0.1), False),
        ((1.0, 1.5, 0.0, 1.0, 0.0, 1.0), False),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), False),
    ],
)
def test_what_no_body_has_is_refused(inertia: tuple[float, ...], possible: bool) -> None:
    body = BodyInertia(mass=1.0, com=(0.0, 0.0, 0.0), inertia=inertia)
    if possible:
        refuse_impossible("elbow", body)
        return
    with pytest.raises(ModelError, match=r"body of elbow: principal moments of"):
        refuse_impossible("elbow", body)
    with pytest.raises(ModelError, match="body of LElbowYaw"):
        Model(ROBOT.urdf, NAMES, {"LElbowYaw": body})


def test_a_body_in_the_place_of_the_urdfs_is_what_a_corrected_urdf_has() -> None:
    """All figures of the model follow, whichever order its joints are given in."""
    q = np.linspace(-0.3, 0.5, 7)
    heavier = BodyInertia(mass=2.0, com=(0.01, 0.02, -0.05), inertia=(0.01, 0, 0, 0.01, 0, 0.01))
    corrected = pin.buildModelFromXML(ROBOT.urdf)
    joint = corrected.getJointId("LElbowRoll")
    corrected.inertias[joint] = pin.Inertia(2.0, np.array(heavier.com), heavier.tensor())
    expected = pin.computeGeneralizedGravity(corrected, corrected.createData(), q)
    for names in (NAMES, NAMES[::-1]):
        here = np.array([q[NAMES.index(name)] for name in names])
        model = Model(ROBOT.urdf, names, {"LElbowRoll": heavier})
        gravity = model.gravity(here)
        assert [gravity[names.index(name)] for name in NAMES] == pytest.approx(expected)
        assert model.mass == pytest.approx(sum(b.mass for b in list(corrected.inertias)[1:]))
        none = np.zeros(7)
        assert -model.dynamics(here, none)[1] == pytest.approx(gravity)


@pytest.mark.parametrize("names", [NAMES, NAMES[::-1], NAMES[3:] + NAMES[:3]])
def test_torques_are_linear_in_the_parameters(names: list[str]) -> None:
    """Y pi = M q_ddot + C q_dot + g, by the change of momentum as the residual sees it."""
    model, rng = Model(ROBOT.urdf, names), np.random.default_rng(2)
    q, v, a = rng.uniform(-0.5, 0.5, (3, 7))
    step = 1e-5
    before, after = (model.dynamics(q + s * v, v + s * a)[0] for s in (-step, step))
    torque = (after - before) / (2.0 * step) - model.dynamics(q, v)[1]
    Y = model.regressor(q, v, a)
    assert np.einsum("ijk,jk->i", Y, model.parameters()) == pytest.approx(torque, abs=1e-6)


def test_the_hand_is_moved_by_the_last_joint_in_any_order() -> None:
    for names in (NAMES, NAMES[::-1]):
        model = Model(ROBOT.urdf, names)
        assert names[model.hand_joint] == "LWristPitch"
        place = np.array([0.1, 0.2, -0.1])
        assert model.in_hand(model.in_joint(place)) == pytest.approx(place)
