"""Bench of the estimator: it measures real arms, and keeps no memory."""

import numpy as np
import pinocchio as pin
import pytest

from bench.estimator import LATE, TURN, Subject, kept, subjects, two_arms
from bench.rigs.lockstep import ROMEO
from estimator.estimate import Flag


@pytest.fixture(scope="module")
def arms() -> list[Subject]:
    return subjects()


def test_arms_of_1_7_and_14_joints_run(arms: list[Subject]) -> None:
    assert [arm.model.nv for arm in arms] == [1, 7, 14]
    for arm in arms:
        n = arm.model.nv
        flags = [arm.estimator.step(*np.zeros((4, n))).flags for _ in range(5)]
        assert flags[-1] is Flag(0), arm.name


def test_two_arms_are_twice_the_arm() -> None:
    text = (ROMEO / "arm.urdf").read_text()
    one, two = pin.buildModelFromXML(text), pin.buildModelFromXML(two_arms(text))
    assert list(two.names)[1:8] == [f"a_{name}" for name in list(one.names)[1:]]
    q = np.linspace(-0.4, 0.4, 7)
    M = pin.crba(one, one.createData(), q).copy()
    both = pin.crba(two, two.createData(), np.concatenate((q, q)))
    np.testing.assert_allclose(both, np.kron(np.eye(2), M), atol=1e-12)
    g = pin.computeGeneralizedGravity(one, one.createData(), q)
    np.testing.assert_allclose(
        pin.computeGeneralizedGravity(two, two.createData(), np.tile(q, 2)), np.tile(g, 2)
    )


def test_a_step_that_keeps_something_is_seen() -> None:
    heap: list[object] = []
    assert kept(lambda: None) <= 20
    # Meanwhile other tests' threads may give some blocks back.
    assert kept(lambda: heap.append(object())) > 0.9 * LATE // TURN
