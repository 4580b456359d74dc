"""The force at the tool: against the same estimate in arrays, what is not seen, and its level."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest
from msgspec.structs import replace

from bench.rigs.lockstep import ROMEO
from common.arrays import Matrix, Vector
from common.errors import ModelError
from daemon.assembly import build_estimator
from daemon.config.load import load_robot
from estimator.dynamics import Dynamics
from estimator.model import Model
from estimator.wrench import COVARIANCE, MISFIT, STRENGTH, UNSEEN, Wrench

T, K = 0.01, 25.0
LEVEL, OFF = 0.038, 0.012
USUAL = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
POSE = np.array([0.4, 0.3, -0.8, -1.0, -1.2, 0.2, 0.3])
ROBOT = load_robot(ROMEO)


class Arm:
    """A Wrench whose joints stand at a pose."""

    def __init__(self, link: str = "", q: Vector = POSE) -> None:
        model: Model = ROBOT.model
        dynamics = Dynamics(model.bodies(), model.down)
        dynamics.at(q.copy(), np.zeros(7))
        place = model.place(link)
        self.wrench = Wrench(dynamics, place, K, True)
        full = pin.buildModelFromXML(ROBOT.urdf)
        data = full.createData()
        pin.computeJointJacobians(full, data, q)
        body = data.oMi[place.body + 1]
        J = pin.getJointJacobian(full, data, place.body + 1, pin.LOCAL_WORLD_ALIGNED)
        axes = (body.rotation @ place.axes).T
        self.J: Matrix = axes @ (J[:3] - pin.skew(body.rotation @ place.point) @ J[3:])
        self.L: Matrix = axes @ J[3:]

    def after(
        self, r: Sequence[float], ticks: int = 1, senses: str = ".......", rises: float = 0.0,
        pressed: bool = False, teaches: bool = False, **parts: float,
    ) -> Vector:  # fmt: skip
        """Shown after ticks of these residuals; x in `senses`: that joint does not sense."""
        w = self.wrench
        for _ in range(ticks):
            np.asarray(w.before)[:] = np.asarray(r) - rises
            for i, each in enumerate(senses):
                made = {"friction": 0.0, "raised": 0.0, "unlearned": 0.0, "torque": 0.0} | parts
                w.weigh(i, r[i], T, USUAL[i], *made.values(), each == ".")
            w.step(T, pressed, teaches)
        return np.array(w.shown)


def covariance_of(row: Vector) -> Matrix:
    C = np.zeros((3, 3))
    C[np.triu_indices(3)] = row[COVARIANCE:STRENGTH]
    return C + np.triu(C, 1).T


@pytest.mark.parametrize("link", ["", "LElbowYawLink"])
@pytest.mark.parametrize("force", [(0.0, 18.0, 0.0), (-7.0, 3.0, 9.0), (0.5, -40.0, 20.0)])
def test_it_is_the_weighted_estimate_in_arrays(link: str, force: Sequence[float]) -> None:
    """The same by least squares for force and moment, iterated as the module does."""
    rng, arm = np.random.default_rng(3), Arm(link)
    r = arm.J.T @ np.array(force) + 0.02 * rng.normal(size=7)
    row = arm.after(r, senses="....x..")
    weight = 1.0 / ((LEVEL * USUAL) ** 2 + 1e-6)
    weight[4] = 0.0
    A, square = np.vstack((arm.J, arm.L)), 0.0
    for any_N in (30.0, 30.0, 1000.0):
        information = (A * weight) @ A.T
        information[:3, :3] += np.eye(3) / any_N**2
        information[3:, 3:] += np.eye(3) / (OFF**2 * square + 1e-6)
        P = np.linalg.inv(information)
        wrench = P @ (A * weight) @ r
        size = float(wrench[:3] @ wrench[:3])
        square = size + min(np.trace(P[:3, :3]), 2.0 * size)
    np.testing.assert_allclose(covariance_of(row), P[:3, :3], rtol=1e-5, atol=1e-6)
    variances, ways = np.linalg.eigh(P[:3, :3])
    seen = variances <= max(16.0, float(wrench[:3] @ wrench[:3]) / 16.0)
    np.testing.assert_allclose(row[:3], (ways * seen) @ ways.T @ wrench[:3], rtol=1e-5, atol=1e-5)
    left = r @ (weight * r) - wrench @ (A * weight) @ r
    assert row[MISFIT] == pytest.approx(np.sqrt(left / 3.0), rel=1e-4)


def test_the_force_of_a_hand_and_two_hands() -> None:
    arm = Arm()
    force = np.array([0.0, 18.0, -5.0])
    row = arm.after(arm.J.T @ force)
    np.testing.assert_allclose(row[:3], force, atol=1.0)
    assert row[STRENGTH] > 1.0
    assert row[MISFIT] < 0.5
    elsewhere = arm.J.T @ force + np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0])
    assert arm.after(elsewhere)[MISFIT] > 2.0


def test_zero_where_nothing_acts_beyond_the_level() -> None:
    arm = Arm()
    weak = arm.J.T @ np.array([0.0, 0.2, 0.0])
    row = arm.after(weak)
    assert 0.0 < row[STRENGTH] < 1.0
    assert not row[:3].any()


@pytest.mark.parametrize("parts", [{"friction": 1.0}, {"raised": 1.0}, {"unlearned": 1.0},
                                   {"torque": 5.0}, {"rises": 1.0}])  # fmt: skip
def test_what_raises_levels_widens_the_bounds(parts: dict[str, float]) -> None:
    arm = Arm()
    r = arm.J.T @ np.array([0.0, 18.0, 0.0])
    sure, unsure = covariance_of(arm.after(r)), covariance_of(arm.after(r, **parts))
    assert np.linalg.eigvalsh(unsure).min() > 2.0 * np.linalg.eigvalsh(sure).min()


def test_directions_that_joints_do_not_show_are_unseen_and_no_force_is_claimed_there() -> None:
    """One joint senses: of the force only its part along that joint's column is known."""
    arm = Arm()
    row = arm.after(arm.J.T @ np.array([9.0, 9.0, 9.0]), senses=".xxxxxx")
    unseen = row[UNSEEN:].reshape(3, 3)
    assert np.count_nonzero(unseen.any(axis=1)) == 2
    assert not unseen[2].any()
    np.testing.assert_allclose(unseen[:2] @ unseen[:2].T, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(unseen[:2] @ row[:3], 0.0, atol=1e-9)
    spread = np.einsum("ki,ij,kj->k", unseen[:2], covariance_of(row), unseen[:2])
    assert np.all(spread > 100.0**2)
    known = arm.J[:, 0] / np.linalg.norm(arm.J[:, 0])
    assert abs(known @ row[:3]) > 5.0
    blind = arm.after(arm.J.T @ np.array([9.0, 9.0, 9.0]), senses="xxxxxxx")
    assert np.count_nonzero(blind[UNSEEN:].reshape(3, 3).any(axis=1)) == 3
    assert not blind[:3].any()


def test_a_torque_elsewhere_is_not_hundreds_of_newtons_along_what_the_joints_hardly_see() -> None:
    """A straight arm: one joint turned from elsewhere is explained by a force along it alone."""
    arm = Arm(q=np.array([0.4, 0.3, -0.8, -0.03, -1.2, 0.0, 0.03]))
    ways, _, _ = np.linalg.svd(arm.J)
    r = arm.J.T @ (200.0 * ways[:, 2])
    row = arm.after(r, friction=0.1)
    sigma = np.sqrt(ways[:, 2] @ covariance_of(row) @ ways[:, 2])
    assert 8.0 < sigma < 0.25 * 200.0
    assert row[STRENGTH] > 1.0
    assert np.abs(row[:3]).max() < 10.0
    assert np.count_nonzero(row[UNSEEN:].reshape(3, 3).any(axis=1)) == 1


def test_the_level_is_learned_of_quiet_motion_alone() -> None:
    arm = Arm()
    first = arm.wrench.level()
    arm.after(np.zeros(7), ticks=3000, teaches=True)
    lower = arm.wrench.level()
    assert 4.0 <= lower < first
    arm.after(np.zeros(7), ticks=3000, teaches=False)
    assert arm.wrench.level() == lower
    noise = arm.J.T @ np.array([0.0, 0.2, 0.0])  # quiet, as it is below the level
    assert arm.after(noise)[STRENGTH] < 1.0
    arm.after(noise, ticks=100, teaches=True, pressed=True)
    assert arm.wrench.level() <= lower
    for _ in range(40):
        arm.after(noise, ticks=200, teaches=True)
    assert lower < arm.wrench.level() <= 8.0


def test_a_link_that_does_not_move_is_refused() -> None:
    with pytest.raises(ModelError, match="moves no link 'torso'"):
        ROBOT.model.place("torso")


@pytest.mark.parametrize(("q", "counts"), [(0.0, True), (0.975, False), (-0.975, False)])
def test_a_link_that_may_lean_on_its_stop_does_not_count(q: float, counts: bool) -> None:
    c = ROBOT.configuration
    made = build_estimator(replace(c, estimator=replace(c.estimator, beside=())), ROBOT.model)
    assert (
        ROBOT.model.upper[6]
        == pytest.approx(-ROBOT.model.lower[6])
        == pytest.approx(0.98, abs=1e-2)
    )
    pose = np.append(POSE[:6], q * ROBOT.model.upper[6] / 0.975)
    for _ in range(20):
        made.step(np.zeros(7), pose, np.zeros(7), pose)
    weight = np.array(made._kernel.wrench.weight)
    assert (weight[:6] > 0.0).all()
    assert (weight[6] > 0.0) == counts
