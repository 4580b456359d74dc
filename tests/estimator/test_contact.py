"""The subtractive dead-band, and the touched link."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.contact import CLEAR, dead_band, touched_link

FINITE = st.floats(-100, 100)


@given(r=FINITE, threshold=st.floats(0.01, 10))
def test_dead_band_is_the_formula(r: float, threshold: float) -> None:
    expected = np.sign(r) * max(abs(r) - threshold, 0.0)
    result = dead_band(np.array([r]), np.array([threshold]))[0]
    assert result == pytest.approx(expected, abs=1e-12)


# The touched link

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
