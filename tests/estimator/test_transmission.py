"""Transmission: validation, the penetration of (5), and the way that a link may fall."""

import numpy as np
import pytest

from common.errors import ModelError
from estimator.transmission import penetration, resting, smooth_sign


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("torque_constant", 0.0), ("torque_constant", np.inf), ("rotor_inertia", -0.1),
        ("half_gap", np.nan), ("half_gap", -0.001), ("motor_coulomb", -1.0),
        ("motor_viscous", -1.0), ("link_coulomb", -1.0), ("link_viscous", np.inf),
        ("gap_coulomb", -1.0), ("gap_viscous", -1.0), ("contact_stiffness", np.nan),
    ],
)  # fmt: skip
def test_a_bad_number_names_field_and_joint(make_transmission, field: str, value: float) -> None:
    values = np.ones(7)
    values[3] = value
    with pytest.raises(ModelError, match=f"{field} of LElbowYaw is"):
        make_transmission(**{field: values})


def test_shapes(make_transmission) -> None:
    with pytest.raises(ModelError, match=r"half_gap has shape \(6,\)"):
        make_transmission(half_gap=np.ones(6))
    with pytest.raises(ModelError, match="half_gap: not numbers"):
        make_transmission(half_gap="wide")
    np.testing.assert_array_equal(make_transmission(half_gap=0.01).half_gap, np.full(7, 0.01))
    with pytest.raises(ValueError, match="read-only"):
        make_transmission().half_gap[0] = 1.0


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan])
def test_sign_width(make_transmission, width: float) -> None:
    with pytest.raises(ModelError, match="sign_width"):
        make_transmission(sign_width=width)


@pytest.mark.parametrize("field", ["contact_stiffness", "contact_damping"])
def test_no_contact_correction_without_gap(make_transmission, field: str) -> None:
    values = np.array([1.0, -1.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    make_transmission(**{field: values})
    values[4] = 0.1
    with pytest.raises(ModelError, match=f"{field} of LWristRoll"):
        make_transmission(**{field: values})


def test_penetration_starts_from_zero_at_the_border() -> None:
    phi = np.array([-0.03, -0.02, -0.01, 0.0, 0.02, 0.05])
    delta = penetration(phi, np.full(6, 0.02))
    np.testing.assert_allclose(delta, [-0.01, 0, 0, 0, 0, 0.03], atol=1e-15)


def test_smooth_sign() -> None:
    v = np.array([-1.0, 0.0, 0.02, 1.0])
    np.testing.assert_allclose(smooth_sign(v, 0.02), [-1, 0, np.tanh(1), 1], atol=1e-15)


def test_rest_is_what_stiction_may_hide() -> None:
    np.testing.assert_allclose(
        resting(np.array([0.0, 0.05, -0.05, 0.1, 1.0])),
        [1, 1 / np.e, 1 / np.e, np.exp(-4), 0],
        atol=1e-12,
    )


def test_a_link_may_fall_to_the_other_border_and_no_further(make_transmission) -> None:
    alpha = 0.02
    t = make_transmission(half_gap=alpha)
    phi = np.array([-alpha, alpha, 0.0, 0.5 * alpha, 3.0 * alpha, 0.0, 0.0])
    sigma = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1 * alpha, 9.0])
    down, up = t.play(phi, sigma)
    np.testing.assert_allclose(down / alpha, [0.0, 2.0, 1.0, 1.5, 2.0, 1.1, 2.0], atol=1e-12)
    np.testing.assert_allclose(up / alpha, [2.0, 0.0, 1.0, 0.5, 0.0, 1.1, 2.0], atol=1e-12)
    assert not make_transmission(half_gap=0.0).play(phi, sigma).any()
