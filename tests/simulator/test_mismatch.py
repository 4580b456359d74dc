"""The true arm: seeded, off by the whole percentage, and refused when it makes no sense."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from common.errors import ConfigurationError, ModelError
from simulator.description import ArmDescription, Mismatch, SimulationSettings
from simulator.mismatch import contact, load_model, true_parameters

NOMINAL = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)


def test_every_quantity_is_off_by_exactly_its_percentage(romeo: ArmDescription) -> None:
    true = true_parameters(romeo, SimulationSettings(seed=4))
    exact = true_parameters(romeo, SimulationSettings(seed=4, mismatch=NOMINAL))
    for field, percent in (
        ("torque_constant", 2.0),
        ("rotor_inertia", 5.0),
        ("coulomb", 10.0),
        ("viscous", 10.0),
    ):
        ratio = getattr(true, field) / getattr(exact, field)
        assert np.abs(ratio - 1.0) == pytest.approx(0.01 * percent), field
        assert len(set(np.sign(ratio - 1.0))) == 2, field
    gaps = exact.half_gap > 0.0
    assert np.abs(true.half_gap[gaps] / exact.half_gap[gaps] - 1.0) == pytest.approx(0.05)
    assert not true.half_gap[~gaps].any()
    for i in range(1, 8):
        ours, nominal = true.model.inertias[i], exact.model.inertias[i]
        assert abs(ours.mass / nominal.mass - 1.0) == pytest.approx(0.03)
        assert ours.inertia / ours.mass == pytest.approx(nominal.inertia / nominal.mass)
        shift = np.linalg.norm(ours.lever - nominal.lever)
        assert shift == pytest.approx(0.03 * np.linalg.norm(nominal.lever))


def test_no_mismatch_is_the_nominal_arm(romeo: ArmDescription) -> None:
    exact = true_parameters(romeo, SimulationSettings(mismatch=NOMINAL))
    assert exact.torque_constant == pytest.approx([j.torque_constant for j in romeo.joints])
    model = load_model(romeo)
    assert all(a.isApprox(b) for a, b in zip(exact.model.inertias, model.inertias, strict=True))


def test_the_seed_decides(romeo: ArmDescription) -> None:
    def friction(seed: int) -> list[float]:
        values: list[float] = true_parameters(romeo, SimulationSettings(seed=seed)).coulomb.tolist()
        return values

    assert friction(1) == friction(1)
    assert friction(1) != friction(2)


def test_contact_is_softened_to_what_the_step_resolves(romeo: ArmDescription) -> None:
    light, rotor = np.array([1e-4, 1e-2]), np.array([1e-2, 1e-2])
    stiffness, damping = contact(light, light, rotor, SimulationSettings(contact_stiffness=500.0))
    reduced = light * rotor / (light + rotor)
    assert stiffness[1] == 500.0
    assert stiffness[0] < 500.0
    assert (0.00025 * np.sqrt(stiffness / reduced) < 0.5).all()
    assert (0.00025 * damping / reduced < 0.5).all()


def test_the_urdf_must_be_the_described_chain(romeo: ArmDescription, tmp_path: Path) -> None:
    swapped = replace(romeo, joints=romeo.joints[::-1])
    with pytest.raises(ModelError, match="LWristPitch"):
        load_model(swapped)
    other = replace(romeo, joints=(replace(romeo.joints[0], name="Thumb"), *romeo.joints[1:]))
    with pytest.raises(ModelError, match="no movable joint 'Thumb': its movable joints are LSh"):
        load_model(other)
    with pytest.raises(ModelError, match=r"none\.urdf: cannot be read: No such file"):
        load_model(replace(romeo, urdf=tmp_path / "none.urdf"))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("gear", 0.0), ("node", 128), ("half_gap", -0.01), ("rotor_inertia", 0.0),
        ("initial_position", 9.0), ("max_current_A", -1.0),
    ],
)  # fmt: skip
def test_a_senseless_joint_is_refused(romeo: ArmDescription, field: str, value: Any) -> None:
    with pytest.raises(ConfigurationError, match=f"LShoulderPitch: {field} = {value}"):
        replace(romeo.joints[0], **{field: value})


@pytest.mark.parametrize(
    "text",
    [
        '{"step_s": 0.001}',
        '{"frction": "smooth"}',
        '{"friction": "x"}',
        '{"mismatch": {"mass": 60}}',
    ],
)
def test_settings_are_bounded_where_they_are_read(text: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(text, type=SimulationSettings)


def test_defaults_survive_a_round_trip() -> None:
    settings = SimulationSettings(mismatch=Mismatch(mass=5.0))
    assert msgspec.convert(msgspec.to_builtins(settings), SimulationSettings) == settings
