"""`contactd new --drive` with RobStride motors: a draft that passes the check and holds."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from bench.rigs.lockstep import BEAM
from daemon.modes.table import Mode
from drivers.makes import guardian_of
from drivers.robstride.settings import MODELS
from programs.contactd.drafts.motor import Load
from programs.contactd.drafts.motors import model_of
from tests.programs.contactd.drafting import config_of, contactd, each, rehearsal


def test_a_draft_is_good_and_its_arm_holds(tmp_path: Path) -> None:
    folder, models = (
        tmp_path / "mine",
        ["robstride:RS02"] * 2 + ["RobStride:rs00", "robstride:EL05"],
    )
    result = contactd("new", folder, "--urdf", BEAM / "arm.urdf", *each("--drive", *models))
    assert result.exit_code == 0, result.output
    assert result.output.count("can be used") == 3
    checked = contactd("check", folder)
    assert checked.exit_code == 0, checked.output
    assert "contactd guard" in checked.output
    written = config_of(folder)
    assert [joint["wiring"]["profile"] for joint in written["joints"]][-1] == "EL05"
    assert written["estimator"]["link_velocity"] == "motor"
    assert all("gap" in joint["known"] for joint in written["joints"])
    assert [joint["half_gap"] for joint in written["joints"]] == [0] * 6
    with rehearsal(folder) as rig:
        assert guardian_of(rig.robot.configuration.joint_drives)
        rig.run(0.5)
        before = rig.arm.plant.q.copy()
        rig.run(1.5)
        assert rig.mode is Mode.HOLDING
        assert np.abs(rig.arm.plant.q - before).max() < 0.02


@pytest.mark.parametrize("model", [f"robstride:{one}" for one in MODELS])
@pytest.mark.parametrize("inertia", [1e-4, 0.05, 2.0])
def test_drafted_gains_are_those_that_a_setpoint_reaches(model: str, inertia: float) -> None:
    drafted = model_of(model)
    load = Load(0.5 * drafted.figures.rated_Nm, inertia)
    text = yaml.safe_load(drafted.text("one", [load]))["one"]
    assert 0.0 < text["stiffness"] <= drafted.figures.stiffest
    assert 0.0 < text["damping"] <= drafted.figures.most_damping
    motor = drafted.motor(load)
    assert motor.max_A * motor.constant <= drafted.figures.torque_max_Nm
