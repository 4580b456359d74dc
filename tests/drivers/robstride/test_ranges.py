"""Ranges of a feedback other than configured, which no motor says: found by `identify wiring`."""

from pathlib import Path
from shutil import copytree

import pytest
import yaml

from bench.rigs.lockstep import BEAM
from bench.rigs.served_daemon import served_daemon, unhurried_drives
from programs.simulate.simulated_robot import true_arm

#: As far apart as the makers' manuals have them for one model.
TORQUE, VELOCITY = 60 / 36, 50 / 33
FOUND = "identified.yaml"


@pytest.mark.parametrize(
    ("name", "register", "factor", "field"),
    [
        ("joint1", "T_MAX", 14 / 17, "torque_max_Nm"),  # upright: gravity does not act
        ("joint2", "T_MAX", TORQUE, "torque_max_Nm"),
        ("joint3", "T_MAX", 17 / 14, "torque_max_Nm"),
        ("joint3", "V_MAX", VELOCITY, "velocity_max"),
    ],
)
def test_a_wrong_one_is_named(
    tmp_path: Path, name: str, register: str, factor: float, field: str
) -> None:
    folder = copytree(BEAM, tmp_path / "arm")
    truth = yaml.safe_load((folder / "simulation.yaml").read_text())
    truth["initial_position"] = {"joint2": 0.15, "joint3": 0.03}  # it bears a load
    for joint in truth["joints"]:
        if joint["name"] == name:
            joint["registers"][register] *= factor
    (folder / "simulation.yaml").write_text(yaml.safe_dump(truth))
    with (
        unhurried_drives(),
        served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served,
    ):
        served.rig.enable()
        result = served.contactd("identify", "wiring", name, "--yes")
    assert result.exit_code == 1, result.output
    assert field in " ".join(result.output.split())
    assert (folder / FOUND).read_bytes() == (BEAM / FOUND).read_bytes()
