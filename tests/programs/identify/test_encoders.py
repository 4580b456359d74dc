"""A link encoder's error, found on a simulated arm, written, and taken off from then on."""

from pathlib import Path

import msgspec
import numpy as np
import yaml

from bench.rigs.lockstep import lockstep_rig
from daemon.config.digests import digests
from daemon.config.identified import same_samples
from daemon.config.load import load_robot
from drivers.wiring import Harmonic
from programs.simulate.simulated_robot import true_arm
from tests.programs.identify import upright_arm

SAID = [Harmonic(order=2, cosine=0.0004, sine=-0.0003)]


def off(folder: Path) -> np.ndarray:
    """Error of the wrist's link position at places of its range [rad]."""
    robot = load_robot(folder)
    errors = []
    for place in np.linspace(-1.5, 1.5, 7).tolist():
        about = yaml.safe_load((folder / "simulation.yaml").read_text())
        about["initial_position"] = {"wrist_roll": place}
        (folder / "simulation.yaml").write_text(yaml.safe_dump(about))
        with lockstep_rig(folder, described=lambda robot, _: true_arm(robot)[0]) as rig:
            rig.run(0.05)
            errors.append(rig.samples.link_position[5] - rig.arm.plant.q[5])
    assert robot.configuration.joint_names[5] == "wrist_roll"
    return np.array(errors)


def test_what_is_written_is_taken_off_and_voids_nothing(tmp_path: Path) -> None:
    folder = upright_arm.write(tmp_path / "arm")
    assert 0.0003 < np.abs(off(folder)).max() < 0.0006
    phase = 1.1 * 5  # as the arm is, by `upright_arm`
    cosine, sine = (0.0005 * np.array([np.sin(phase), np.cos(phase)])).tolist()
    true = {"order": 2, "cosine": cosine, "sine": sine}
    entry = {"date": "2026-11-23", "log": "00", "link_correction": [true], "left": 0.1}
    (folder / "identified.yaml").write_text(
        yaml.safe_dump({"joints": {"wrist_roll": {"encoders": entry}}})
    )
    assert np.abs(off(folder)).max() < 0.00005  # a count of 17 bit


def test_a_correction_of_the_configuration_keeps_every_mark(tmp_path: Path) -> None:
    """Half a milliradian is no reason to check the wiring again."""
    robot = load_robot(upright_arm.write(tmp_path / "arm"))
    first, *others = robot.configuration.joints
    wiring = msgspec.structs.replace(first.wiring, link_correction=SAID)
    joints = [msgspec.structs.replace(first, wiring=wiring), *others]
    changed = msgspec.structs.replace(robot.configuration, joints=joints)
    assert digests(changed, robot.urdf) == digests(robot.configuration, robot.urdf)
    assert not same_samples(changed, robot.configuration)  # of recordings
