"""Properties of the force at the tool on any arm: two to seven joints, any pose and frame,
forces of any size, and joints that do not sense or say nonsense."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

from common.arrays import Matrix, Vector
from estimator.dynamics import Dynamics, Place
from estimator.model import Model
from estimator.wrench import COVARIANCE, MISFIT, SEEN_MOST_N, SEEN_N, STRENGTH, UNSEEN, Wrench

T, K = 0.01, 25.0
SEEDS = range(24)
LINK = (
    '<link name="link{k}"><inertial><origin xyz="0.05 0 0.02"/><mass value="0.8"/><inertia '
    'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="joint{k}" type="revolute"><parent link="link{k}"/><child link="link{next}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
)


@dataclass(frozen=True)
class Arm:
    """A random arm at a pose, with the point and axes of its force, and pinocchio's J of them."""

    model: Model
    place: Place
    q: Vector
    J: Matrix  # (6, n)

    def shown(
        self, r: Vector, level: float = 0.1, senses: str = "", place: Place | None = None
    ) -> Vector:
        """After one tick of residuals (n,), quiet before; x in `senses`: does not sense."""
        dynamics = Dynamics(self.model.bodies(), self.model.down)
        dynamics.at(self.q.copy(), np.zeros(len(self.q)))
        wrench = Wrench(dynamics, place or self.place, K, True)
        np.asarray(wrench.before)[:] = r
        for i, each in enumerate(senses or "." * len(r)):
            wrench.weigh(i, r[i], T, level, 0.0, 0.0, 0.0, 0.0, each == ".")
        wrench.step(T, False, False)
        return np.array(wrench.shown)


def arm(seed: int) -> Arm:
    """The caller's order of joints is not the URDF's."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 6

    def words(values: Vector) -> str:
        return " ".join(f"{value:.6f}" for value in values)

    parts = [LINK.format(k=k) for k in range(n + 1)]
    for k in range(n):
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        parts.append(
            JOINT.format(k=k, next=k + 1, xyz=words(rng.uniform(-0.2, 0.2, 3)),
                         rpy=words(rng.uniform(-3.0, 3.0, 3)), axis=words(axis))
        )  # fmt: skip
    urdf = f'<robot name="any">{"".join(parts)}</robot>'
    names = [f"joint{k}" for k in rng.permutation(n)]
    model = Model(urdf, names)
    place = model.place("" if rng.uniform() < 0.5 else f"link{rng.integers(1, n + 1)}")
    q = rng.uniform(-1.0, 1.0, n)
    full = pin.buildModelFromXML(urdf)
    data = full.createData()
    inward = np.zeros(n)
    order = [full.joints[full.getJointId(name)].idx_v for name in names]
    inward[order] = q
    pin.computeJointJacobians(full, data, inward)
    body = data.oMi[place.body + 1]
    J = pin.getJointJacobian(full, data, place.body + 1, pin.LOCAL_WORLD_ALIGNED)[:, order]
    J[:3] -= pin.skew(body.rotation @ place.point) @ J[3:]
    axes = (body.rotation @ place.axes).T
    return Arm(model, place, q, np.vstack((axes @ J[:3], axes @ J[3:])))


def covariance_of(row: Vector) -> Matrix:
    C = np.zeros((3, 3))
    C[np.triu_indices(3)] = row[COVARIANCE:STRENGTH]
    return C + np.triu(C, 1).T


def sound(row: Vector) -> Matrix:
    """Unseen directions (k, 3) of what is shown, after checks of what always holds."""
    assert np.isfinite(row).all()
    C, unseen = covariance_of(row), row[UNSEEN:].reshape(3, 3)
    unseen = unseen[unseen.any(axis=1)]
    sigma = np.sqrt(np.linalg.eigvalsh(C))
    assert sigma.min() > 0.0
    np.testing.assert_allclose(unseen @ unseen.T, np.eye(len(unseen)), atol=1e-9)
    size = float(np.linalg.norm(row[:3]))
    np.testing.assert_allclose(unseen @ row[:3], 0.0, atol=1e-9 * (1.0 + size))
    for way in unseen:  # never a zero that is believed
        assert np.sqrt(way @ C @ way) > SEEN_N
    most = max(SEEN_N, min(0.25 * size, SEEN_MOST_N))
    assert np.count_nonzero(sigma > most * (1.0 + 1e-9)) == len(unseen)
    return unseen


@pytest.mark.parametrize("seed", SEEDS)
def test_a_force_is_found_along_what_is_seen_and_nothing_is_claimed_of_the_rest(seed: int) -> None:
    one, rng = arm(seed), np.random.default_rng(seed)
    force = 10.0 ** rng.uniform(0.5, 2.0) * rng.normal(size=3)
    row = one.shown(one.J[:3].T @ force)
    unseen = sound(row)
    seen = np.eye(3) - unseen.T @ unseen
    C = covariance_of(row)
    most = 4.0 if row[STRENGTH] > 1.0 else 8.0  # standard deviations: the level at most
    for way in np.linalg.svd(seen)[0].T[: 3 - len(unseen)]:
        assert abs(way @ (row[:3] - force)) < most * np.sqrt(way @ C @ way)
    levers = np.linalg.svd(one.J[:3])[0]
    for way in levers.T:  # what no joint shows is never seen
        if np.linalg.norm(one.J[:3].T @ way) < 1e-4:
            assert np.linalg.norm(unseen @ way) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_it_turns_with_its_frame_and_with_its_sign(seed: int) -> None:
    one, rng = arm(seed), np.random.default_rng(seed)
    r = one.J[:3].T @ (20.0 * rng.normal(size=3)) + 0.05 * rng.normal(size=len(one.q))
    row, back = one.shown(r), one.shown(-r)
    np.testing.assert_allclose(back[:3], -row[:3], atol=1e-9)
    np.testing.assert_allclose(back[COVARIANCE:], row[COVARIANCE:], atol=1e-9)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.linalg.det(R)
    turned = one.shown(r, place=replace(one.place, axes=one.place.axes @ R))
    np.testing.assert_allclose(turned[:3], R.T @ row[:3], rtol=1e-6, atol=1e-6)
    C = covariance_of(row)
    np.testing.assert_allclose(covariance_of(turned), R.T @ C @ R, rtol=1e-3, atol=1e-4 * C.max())
    np.testing.assert_allclose(turned[[STRENGTH, MISFIT]], row[[STRENGTH, MISFIT]], atol=1e-3)
    assert len(sound(turned)) == len(sound(row))


@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -1e6])
@pytest.mark.parametrize("seed", SEEDS[:6])
def test_a_joint_that_does_not_sense_changes_nothing_whatever_it_says(
    seed: int, nonsense: float
) -> None:
    one, rng = arm(seed), np.random.default_rng(seed)
    r = one.J[:3].T @ (20.0 * rng.normal(size=3))
    senses = "x" + "." * (len(r) - 1)
    without = one.shown(r, senses=senses)
    r[0] = nonsense
    np.testing.assert_array_equal(one.shown(r, senses=senses), without)
    sound(without)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e3, 1e6])
@pytest.mark.parametrize("seed", SEEDS[:6])
def test_any_size_of_residual_and_level_is_sound(seed: int, size: float) -> None:
    one, rng = arm(seed), np.random.default_rng(seed)
    for level in (0.0, 0.1, 1e6):
        sound(one.shown(size * rng.normal(size=len(one.q)), level=level))
