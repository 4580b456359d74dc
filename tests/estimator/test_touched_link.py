"""The touched link, from the pattern of the residual."""

import numpy as np
import pinocchio as pin
import pytest

from estimator.contact_detector import ContactDetector
from estimator.levels import Levels
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission


def detector(contact: np.ndarray, per_speed: float = 0.0) -> ContactDetector:
    n = len(contact)
    names = ("torque_constant", "rotor_inertia", "half_gap", "motor_coulomb", "motor_viscous",
             "link_coulomb", "link_viscous")  # fmt: skip
    joints = tuple(f"joint {i}" for i in range(n))
    transmission = Transmission(joints=joints, **{name: np.ones(n) for name in names})
    thresholds = Thresholds(contact, 2 * contact, per_speed=np.array(per_speed))
    levels = Levels(transmission, thresholds, EstimatorSettings())
    for i in range(n):
        levels.put_in_force(i, 0.0, 0.0, 0.0, 0.01)
    return ContactDetector(joints, levels, 1)


LEVEL = np.array([0.8, 0.5, 0.4])


@pytest.mark.parametrize(
    ("strength", "link"),
    [
        ([1.2, 0.0, 0.0], 0),
        ([1.2, -0.9, 0.1], 1),
        ([0.1, 0.0, -1.5], 2),
        ([1.2, 0.36, 0.0], 1),
        ([1.2, 0.34, 0.0], -1),  # perhaps the second
        ([1.2, 0.0, 0.2], -1),
        ([0.2, 0.1, 0.0], -1),
        ([0.1, 0.1, 0.0], -1),
    ],
)
def test_pattern(strength: list[float], link: int) -> None:
    assert detector(LEVEL).touched_link(np.array(strength) * LEVEL) == link


def test_a_force_is_never_felt_beyond_its_link(romeo_urdf) -> None:
    # Forces at points of every link, by their Jacobians: the answer is that link or one before.
    model = pin.buildModelFromUrdf(str(romeo_urdf))
    data, rng = model.createData(), np.random.default_rng(3)
    right, joints = 0, detector(np.full(7, 0.2))
    for trial in range(210):
        link = trial % 7
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        jacobian = pin.computeJointJacobian(model, data, q, link + 1)
        point, force = model.inertias[link + 1].lever, rng.normal(size=3)
        torque = jacobian.T @ np.concatenate([force, np.cross(point, force)])
        torque *= 3.0 * 0.2 / np.abs(torque).max()
        answer = joints.touched_link(torque)
        assert answer <= link
        right += answer == link
    assert right > 80  # many forces have no lever about the link's own joint


def test_what_raises_the_levels_is_no_sign_of_a_touch() -> None:
    joints, residual = detector(LEVEL), np.array([1.2, 0.0, 0.5]) * LEVEL
    assert joints.touched_link(residual) == 2
    joints.levels.put_in_force(2, 0.0, 0.4 * LEVEL[2], 0.0, 0.01)
    assert joints.touched_link(residual) == 0
    for names in ("friction", "raised"):  # nor friction that may be off
        joints = detector(LEVEL)
        np.asarray(getattr(joints.levels, names))[2] = 0.4 * LEVEL[2]
        joints.levels.put_in_force(2, 0.0, 0.0, 0.0, 1e-9)
        assert joints.touched_link(residual) == 0


def test_what_grows_with_speed_is_no_sign_of_a_touch() -> None:
    """The model's errors grow so, and levels with them."""
    joints, residual = detector(LEVEL, per_speed=0.3), np.array([1.2, 0.0, 0.5]) * LEVEL
    assert joints.touched_link(residual) == 2
    joints.levels.put_in_force(2, 0.0, 0.0, 0.4 * LEVEL[2] / 0.3, 0.01)
    assert joints.touched_link(residual) == 0


@pytest.mark.parametrize(
    ("share", "strength", "link"),
    [
        (0.5, 0.36, 1),  # what is needed of the level is more than what is clear
        (0.5, 0.34, -1),
        (0.2, 0.21, 1),  # what is past the level is clear in any case
        (0.2, 0.19, -1),
        (0.2, 0.11, -1),
        (0.2, 0.09, 0),  # half of that is clearly absent
    ],
)
def test_what_was_learned_makes_less_clear(share: float, strength: float, link: int) -> None:
    joints = detector(LEVEL)
    np.asarray(joints.levels.share)[1] = share
    for i in range(3):
        joints.levels.put_in_force(i, 0.0, 0.0, 0.0, 0.01)
    assert joints.touched_link(np.array([1.2, strength, 0.0]) * LEVEL) == link
