"""`contactd new --drive`: motors without an EDS, to an arm that is checked, and that holds."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from bench.rigs.lockstep import BEAM, OPENARM, lockstep_rig
from daemon.modes.table import Mode
from drivers.damiao.settings import MODELS as DAMIAO
from drivers.makes import guardian_of
from drivers.robstride.settings import MODELS as ROBSTRIDE
from programs.contactd.contactd import main
from programs.contactd.drafts.motor import Load
from programs.contactd.drafts.motors import model_of
from programs.simulate.simulated_robot import read_simulation


def new(folder: Path, urdf: Path, *models: str):
    words = ["new", str(folder), "--urdf", str(urdf)]
    for model in models:
        words += ["--drive", model]
    return CliRunner().invoke(main, words)


@pytest.mark.parametrize(
    ("arm", "models", "last"),
    [
        (OPENARM, ["damiao:DM8009"] * 2 + ["damiao:DM4340"] * 2 + ["damiao:DM4310"], "DM4310"),
        (BEAM, ["robstride:RS02", "robstride:RS02", "RobStride:rs00", "robstride:EL05"], "EL05"),
    ],
)
def test_a_draft_is_good_and_its_arm_holds(
    tmp_path: Path, arm: Path, models: list[str], last: str
) -> None:
    folder = tmp_path / "mine"
    result = new(folder, arm / "arm.urdf", *models)
    assert result.exit_code == 0, result.output
    assert result.output.count("can be used") == len(set(models))
    checked = CliRunner().invoke(main, ["check", str(folder)])
    assert checked.exit_code == 0, checked.output
    assert "contactd guard" in checked.output
    written = yaml.safe_load((folder / "config.yaml").read_text())
    assert [joint["wiring"]["profile"] for joint in written["joints"]][-1] == last
    gapless = arm == BEAM
    assert all((joint["half_gap"] == 0) is gapless for joint in written["joints"])
    with lockstep_rig(folder) as rig:
        assert read_simulation(rig.robot).joints
        assert guardian_of(rig.robot.configuration.joint_drives)
        rig.enable()
        rig.run(0.5)
        before = rig.arm.plant.q.copy()
        rig.run(1.5)
        assert rig.mode is Mode.HOLDING
        assert np.abs(rig.arm.plant.q - before).max() < 0.02


@pytest.mark.parametrize("model", ["robstride:RS99", "RS02", "moteus:r4"])
def test_a_model_that_is_not_known_is_refused_with_those_that_are(
    tmp_path: Path, model: str
) -> None:
    result = new(tmp_path / "mine", BEAM / "arm.urdf", model)
    assert result.exit_code == 78
    assert "robstride:RS02" in result.output
    assert "damiao:DM4340" in result.output


@pytest.mark.parametrize(
    "model", [f"damiao:{one}" for one in DAMIAO] + [f"robstride:{one}" for one in ROBSTRIDE]
)
@pytest.mark.parametrize("inertia", [1e-4, 0.05, 2.0])
def test_drafted_gains_are_those_that_a_setpoint_reaches(model: str, inertia: float) -> None:
    drafted = model_of(model)
    load = Load(0.5 * drafted.figures.rated_Nm, inertia)
    text = yaml.safe_load(drafted.text("one", [load]))["one"]
    assert 0.0 < text["stiffness"] <= drafted.figures.stiffest
    assert 0.0 < text["damping"] <= drafted.figures.most_damping
    if drafted.make == "robstride":
        motor = drafted.motor(load)
        assert motor.max_A * motor.constant <= drafted.figures.torque_max_Nm
