"""Rigid-body dynamics against finite differences, energy, and the caller's order of joints."""

import re

import numpy as np
import pytest

from common.errors import ModelError
from estimator.model import Model

STEP = 1e-5


def mass(model: Model, q: np.ndarray) -> np.ndarray:
    """M(q): momentum is linear in the velocity."""
    return np.stack([model.dynamics(q, unit)[0] for unit in np.eye(model.n)], axis=1)


def motion(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, q_dot, q_ddot of a smooth motion of seven joints."""
    rng = np.random.default_rng(3)
    amplitude, omega, start = rng.uniform(0.2, 0.8, 7), rng.uniform(1, 4, 7), rng.uniform(0, 6, 7)
    phase = omega * t + start
    return (
        amplitude * np.sin(phase),
        amplitude * omega * np.cos(phase),
        -amplitude * omega**2 * np.sin(phase),
    )


@pytest.mark.parametrize("t", [0.0, 0.7, 1.9])
def test_beta_is_the_rate_of_momentum_less_inertial_torque(romeo: Model, t: float) -> None:
    # d/dt (M q_dot) = M q_ddot + M_dot q_dot, and the arm's equation is M q_ddot + c = tau.
    # Hence M_dot q_dot - c = C^T q_dot - g; c by Newton-Euler on the energy below.
    after, _ = romeo.dynamics(*motion(t + STEP)[:2])
    before, _ = romeo.dynamics(*motion(t - STEP)[:2])
    q, q_dot, qdd = motion(t)
    _, beta = romeo.dynamics(q, q_dot)
    M_dot_qd = (after - before) / (2 * STEP) - mass(romeo, q) @ qdd
    later, earlier = (mass(romeo, motion(t + step)[0]) for step in (STEP, -STEP))
    M_dot = (later - earlier) / (2 * STEP)
    np.testing.assert_allclose(M_dot_qd, M_dot @ q_dot, atol=1e-7)

    # C^T q_dot is the gradient of the kinetic energy at fixed q_dot: no second model needed.
    def kinetic(q: np.ndarray) -> float:
        return 0.5 * float(q_dot @ mass(romeo, q) @ q_dot)

    gradient = [
        (kinetic(q + STEP * unit) - kinetic(q - STEP * unit)) / (2 * STEP) for unit in np.eye(7)
    ]
    np.testing.assert_allclose(beta + romeo.gravity(q), gradient, atol=1e-7)


def test_momentum_is_mass_times_velocity(romeo: Model) -> None:
    q, q_dot, _ = motion(0.4)
    momentum, _ = romeo.dynamics(q, q_dot)
    M = mass(romeo, q)
    np.testing.assert_allclose(momentum, M @ q_dot, atol=1e-12)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    assert np.linalg.eigvalsh(M).min() > 0


ANSWERS = (
    lambda model, q, q_dot, _: model.dynamics(q, q_dot),
    lambda model, q, *_: model.payload_torques(q, model.down),
    lambda model, q, *_: (model.gravity(q), model.inertia(q), model.tool_jacobian(q)),
    lambda model, *motion: (model.regressor(*motion),),
)


def answers(model: Model, t: float, order: tuple[int, ...] = (0, 1, 2, 3)) -> list[np.ndarray]:
    """All that a model computes of one moment of a motion, asked in this order."""
    found = {k: ANSWERS[k](model, *motion(t)) for k in order}
    return [x for k in sorted(found) for x in found[k]]


def test_users_of_one_model_do_not_disturb_each_other(romeo: Model, romeo_urdf) -> None:
    for names in (romeo.names, romeo.names[::-1]):
        shared, alone = Model(romeo_urdf, names), Model(romeo_urdf, names)
        kept = answers(shared, 0.4)
        then = [x.copy() for x in kept]
        for of_one, of_other in zip(
            answers(shared, 1.1), answers(alone, 1.1, (3, 2, 1, 0)), strict=True
        ):
            np.testing.assert_array_equal(of_one, of_other)
        for before, after in zip(then, kept, strict=True):
            np.testing.assert_array_equal(before, after)


def test_joints_in_any_order(romeo: Model, romeo_urdf) -> None:
    order = [3, 0, 6, 1, 5, 2, 4]
    other = Model(romeo_urdf, [romeo.names[i] for i in order])
    q, q_dot, _ = motion(1.1)
    momentum, beta = romeo.dynamics(q, q_dot)
    for ours, theirs in zip(other.dynamics(q[order], q_dot[order]), (momentum, beta), strict=True):
        np.testing.assert_allclose(ours, theirs[order], atol=1e-14)
    np.testing.assert_array_equal(other.gravity(q[order]), romeo.gravity(q)[order])
    for name in ("lower", "upper"):
        np.testing.assert_array_equal(getattr(other, name), getattr(romeo, name)[order])


def test_limits_are_the_urdfs(romeo: Model) -> None:
    assert romeo.n == 7
    assert romeo.lower[0] == -1.44478
    assert romeo.upper[3] == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda names: (*names[:-1], "Elbow"), "no movable joint 'Elbow'"),
        (lambda names: names[:-1], "'LWristPitch' moves but is not measured"),
        (lambda names: (*names[:-1], names[0]), "'LShoulderPitch' is named twice"),
    ],
)
def test_joints_that_do_not_fit(romeo: Model, romeo_urdf, change, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Model(romeo_urdf, change(romeo.names))


def test_files_that_do_not_fit(tmp_path, romeo: Model, romeo_urdf) -> None:
    with pytest.raises(ModelError, match=r"none\.urdf"):
        Model(tmp_path / "none.urdf", ["a"])
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot")
    with pytest.raises(ModelError, match=r"broken\.urdf"):
        Model(broken, ["a"])
    endless = tmp_path / "endless.urdf"
    endless.write_text(romeo_urdf.read_text().replace('"revolute"', '"continuous"', 1))
    with pytest.raises(ModelError, match="'LShoulderPitch' must be revolute"):
        Model(endless, romeo.names)
    sliding = tmp_path / "sliding.urdf"
    sliding.write_text(romeo_urdf.read_text().replace('"revolute"', '"prismatic"', 1))
    with pytest.raises(ModelError, match="'LShoulderPitch' must be revolute"):
        Model(sliding, romeo.names)


def without(urdf: str, pattern: str) -> str:
    return re.sub(pattern, "", urdf, flags=re.DOTALL)


INERTIAL = r"<inertial>.*?</inertial>"


def test_joints_that_move_no_mass(romeo: Model, romeo_urdf) -> None:
    text = romeo_urdf.read_text()
    with pytest.raises(ModelError, match="nothing that joint 'LShoulderPitch' moves has a mass"):
        Model(without(text, INERTIAL), romeo.names)
    start = text.index('name="LWristYawLink"')
    with pytest.raises(ModelError, match="nothing that joint 'LWristYaw' moves has a mass"):
        Model(text[:start] + without(text[start:], INERTIAL), romeo.names)
    # A link may be without: here the upper arm, of which the next one may have all.
    Model(re.sub(INERTIAL, "", text, count=1, flags=re.DOTALL), romeo.names)


def test_points_of_mass_are_enough_beside_an_axis(romeo: Model, romeo_urdf) -> None:
    points = re.sub(r'(i[xyz][xyz])="[^"]*"', r'\1="0"', romeo_urdf.read_text())
    model = Model(points, romeo.names)
    assert np.diag(mass(model, np.zeros(7))).min() > 1e-6
    # The whole of the wrist on the axis of LWristRoll, x, where it is straight: at zero, and not in
    # the middle between these limits.
    points = points.replace('upper="0.977384"', 'upper="0.5"')
    start = points.index('name="LWristRollLink"')
    on_axis = points[:start] + re.sub(
        r'<origin xyz="([^ "]*)[^"]*"', r'<origin xyz="\1 0 0"', points[start:]
    )
    with pytest.raises(ModelError, match=r"'LWristRoll' moves an inertia of \S+ kg m2 about its"):
        Model(on_axis, romeo.names)
