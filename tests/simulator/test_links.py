"""Accelerations of links against pinocchio's, on chains and trees, of joints that turn or slide."""

import numpy as np
import pinocchio as pin
import pytest

from simulator.description import ArmDescription
from simulator.links import Links
from simulator.mismatch import load_model
from simulator.plant import ArticulatedBodies

TREE = (-1, 0, 1, 1, 3, 0, 5, -1, 7)


def random_tree(rng: np.random.Generator, kinds: str) -> pin.Model:
    """Nine joints about and along random axes, each on the one that TREE says."""
    model = pin.Model()
    model.gravity.linear = rng.normal(size=3) * 9.8
    for k, (parent, kind) in enumerate(zip(TREE, kinds, strict=True)):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        joint = {"R": pin.JointModelRevoluteUnaligned, "P": pin.JointModelPrismaticUnaligned}[kind]
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        index = model.addJoint(parent + 1, joint(axis), place, f"joint {k}")
        root = rng.normal(size=(3, 3))
        body = pin.Inertia(rng.uniform(0.1, 2.0), rng.normal(size=3), root @ root.T)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
    return model


def compare(model: pin.Model, rng: np.random.Generator) -> None:
    links, data = Links(model), model.createData()
    for _ in range(50):
        q, q_dot, tau = rng.normal(size=(3, model.nv)) * [[2.0], [5.0], [10.0]]
        found, expected = tau.copy(), pin.aba(model, data, q, q_dot, tau)
        links.accelerate(q, q_dot, found, found)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("kinds", ["RRRRRRRRR", "RRPRRPRRP", "PPPPPPPPP"])
def test_trees(kinds: str) -> None:
    rng = np.random.default_rng(6)
    for _ in range(3):
        compare(random_tree(rng, kinds), rng)


def test_the_arm(romeo: ArmDescription) -> None:
    compare(load_model(romeo), np.random.default_rng(7))


def test_where_links_are_not_compiled_pinocchio_stands_in(romeo: ArmDescription) -> None:
    model = load_model(romeo)
    links, bodies = Links(model), ArticulatedBodies(model)
    for gravity in (np.array([0.0, 0.0, -9.81]), np.array([3.0, -2.0, 0.0])):
        np.asarray(links.gravity)[:] = np.asarray(bodies.gravity)[:] = gravity
        q, q_dot, tau = np.random.default_rng(8).normal(size=(3, 7))
        one, other = np.zeros((2, 7))
        links.accelerate(q, q_dot, tau, one)
        bodies.accelerate(q, q_dot, tau, other)
        np.testing.assert_allclose(one, other, rtol=1e-9)
