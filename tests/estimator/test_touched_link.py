"""Touched link: that of the last joint whose residual is clear, or undecided."""

import numpy as np
import pinocchio as pin
import pytest

from estimator.contact import CLEAR, touched_link

LEVEL = np.array([0.8, 0.5, 0.4])


@pytest.mark.parametrize(
    ("strength", "link"),
    [
        ([1.2, 0.0, 0.0], 0),
        ([1.2, -0.9, 0.1], 1),
        ([0.1, 0.0, -1.5], 2),
        ([1.2, CLEAR + 0.01, 0.0], 1),
        ([1.2, CLEAR - 0.01, 0.0], None),  # perhaps the second
        ([1.2, 0.0, 0.2], None),
        ([0.2, 0.1, 0.0], None),
    ],
)
def test_pattern(strength: list[float], link: int | None) -> None:
    assert touched_link(np.array(strength) * LEVEL, LEVEL) == link


def test_a_force_is_never_felt_beyond_its_link(romeo_urdf) -> None:
    # Forces at points of every link, by their Jacobians: the answer is that link or one before.
    model = pin.buildModelFromUrdf(str(romeo_urdf))
    data, rng = model.createData(), np.random.default_rng(3)
    right = 0
    for trial in range(210):
        link = trial % 7
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        jacobian = pin.computeJointJacobian(model, data, q, link + 1)
        point, force = model.inertias[link + 1].lever, rng.normal(size=3)
        torque = jacobian.T @ np.concatenate([force, np.cross(point, force)])
        torque *= 3.0 * 0.2 / np.abs(torque).max()
        answer = touched_link(torque, np.full(7, 0.2))
        assert answer is None or answer <= link
        right += answer == link
    assert right > 80  # many forces have no lever about the link's own joint
