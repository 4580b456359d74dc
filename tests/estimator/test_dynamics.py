"""Recursive dynamics against pinocchio, on chains and trees, of joints that turn and that slide."""

import numpy as np
import pinocchio as pin
import pytest

from estimator.dynamics import Body, Dynamics
from estimator.model import Model
from tests.estimator.plain import built, plain

RNG = np.random.default_rng(4)
TREE = (-1, 0, 1, 1, 3, 0, 5, -1, 7)
KINDS = "RRPRRPRRP"


def random_tree() -> pin.Model:
    """Nine joints about and along random axes, each on the one that TREE says."""
    model = pin.Model()
    model.gravity.linear = np.array([0.4, -0.7, -9.6])
    for k, (parent, kind) in enumerate(zip(TREE, KINDS, strict=True)):
        axis = RNG.normal(size=3)
        axis /= np.linalg.norm(axis)
        joint = {"R": pin.JointModelRevoluteUnaligned, "P": pin.JointModelPrismaticUnaligned}[kind]
        index = model.addJoint(parent + 1, joint(axis), pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(index, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def ours(model: pin.Model, module=None) -> Dynamics:
    bodies = []
    for k in range(model.nv):
        joint, inertia, place = (
            x[k + 1] for x in (model.joints, model.inertias, model.jointPlacements)
        )
        data = joint.createData()
        joint.calc(data, np.zeros(model.nq), np.zeros(model.nv))
        axis = np.asarray(data.S).ravel()
        bodies.append(
            Body(
                parent=model.parents[k + 1] - 1, row=k, rotation=place.rotation,
                translation=place.translation, turning=axis[3:], sliding=axis[:3],
                mass=inertia.mass, moment=inertia.mass * inertia.lever,
                inertia=inertia.matrix()[3:, 3:],
            )
        )  # fmt: skip
    return (module or built()["dynamics"]).Dynamics(bodies, model.gravity.linear)


def theirs(model: pin.Model, q: np.ndarray, q_dot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    data = model.createData()
    upper = np.triu(pin.crba(model, data, q))
    M = upper + np.triu(upper, 1).T
    C = pin.computeCoriolisMatrix(model, data, q, q_dot)
    return M @ q_dot, q_dot @ C - pin.computeGeneralizedGravity(model, data, q)


@pytest.mark.parametrize("times", range(3))
def test_trees_of_all_kinds(times: int) -> None:
    model = random_tree()
    dynamics = ours(model)
    for _ in range(50):
        q, q_dot = RNG.uniform(-3, 3, (2, model.nv))
        dynamics.at(q, q_dot)
        for found, expected in zip(
            (dynamics.momentum, dynamics.beta), theirs(model, q, q_dot), strict=True
        ):
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(np.asarray(found) / scale, expected / scale, atol=2e-14)


def test_the_arm(romeo: Model, romeo_urdf) -> None:
    model = pin.buildModelFromUrdf(str(romeo_urdf))
    for _ in range(100):
        q, q_dot = RNG.uniform(-2, 2, (2, 7))
        for found, expected in zip(romeo.dynamics(q, q_dot), theirs(model, q, q_dot), strict=True):
            np.testing.assert_allclose(found, expected, atol=2e-14)


def test_compiled_and_plain_are_the_same_to_the_last_bit() -> None:
    model = random_tree()
    one, other = ours(model), ours(model, plain()["dynamics"])
    if type(one).at is type(other).at:
        pytest.skip("the modules are not compiled here")
    for _ in range(50):
        q, q_dot = RNG.uniform(-3, 3, (2, model.nv))
        for dynamics in (one, other):
            dynamics.at(q, q_dot)
        for name in ("momentum", "beta"):
            a, b = (np.asarray(getattr(x, name)) for x in (one, other))
            assert a.tobytes() == b.tobytes()
