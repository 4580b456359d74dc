"""Truth of a simulated arm: `simulation.yaml`, apart from `config.yaml`, for any make of drive."""

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from bench.rigs.generated_arms import generate
from bench.rigs.generated_makes import MAKES
from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT, lockstep_rig
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from programs.contactd.contactd import main
from programs.simulate.simulated_robot import describe, read_simulation, refused_drives, true_arm
from simulator.state_machine import State


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return generate(0).write(tmp_path / "arm")


def written(folder: Path) -> dict:
    return yaml.safe_load((folder / "simulation.yaml").read_text())


def change(folder: Path, edit) -> None:
    data = written(folder)
    edit(data)
    (folder / "simulation.yaml").write_text(yaml.safe_dump(data, sort_keys=False))


def set_quirks(folder: Path, **quirks) -> None:
    change(folder, lambda data: data["drives"]["servo"].update(quirks=quirks))


def wrong_encoder(data: dict, encoder: str) -> None:
    data["joints"][0]["encoder_errors"] = [{"encoder": encoder, "amplitude": 0.001}]


def true_rig(folder: Path):
    return lockstep_rig(folder, described=lambda robot, _: true_arm(robot)[0])


@pytest.mark.parametrize("seed", range(len(MAKES)), ids=[make.name for make in MAKES])
def test_any_make_is_set_up_enabled_and_moved_as_its_data_sheet_says(seed, tmp_path):
    """Units, signs, zeros, identity and PDOs: what the daemon reads is where the plant is."""
    folder = generate(seed).write(tmp_path / "arm")
    with true_rig(folder) as rig:
        rig.enable()
        plant = rig.arm.plant
        assert np.abs(rig.samples.link_position - plant.q).max() < 2e-4
        rig.arm.external_torque[:] = 0.5 * np.array(
            [joint.thresholds.contact for joint in rig.robot.configuration.joints]
        )
        rig.run(0.3)
        # Motors resist what pushes: the sign of their current, and of what they give, is the same.
        assert np.abs(rig.samples.link_position - plant.q).max() < 2e-4
        current = rig.arm.servo.current
        commanded = rig.samples.current
        assert (np.abs(current) > 0.05).any()
        assert np.abs(commanded - current).max() < 0.1 + 0.2 * np.abs(current).max()
        for drive, joint in zip(rig.arm.drives, rig.robot.configuration.joints, strict=True):
            assert drive.node == joint.wiring.node
            assert drive.state is State.OPERATION_ENABLED


def test_correcting_the_configuration_does_not_move_the_truth(tmp_path):
    folder = generate(2).write(tmp_path / "arm")
    before, _ = true_arm(load_robot(folder))
    data = yaml.safe_load((folder / "config.yaml").read_text())
    joint = data["joints"][1]
    joint["torque_constant"] *= 1.1
    joint["half_gap"] = 0.001
    joint["wiring"]["link_sign"] *= -1
    data["drives"]["servo"]["motor_velocity"]["sign"] = -1
    (folder / "config.yaml").write_text(yaml.safe_dump(data))
    assert true_arm(load_robot(folder))[0] == before


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM, SINGLE_JOINT], ids=lambda f: f.name)
def test_shipped_arms_are_what_their_configurations_say(folder):
    """As in rigs, which simulate what they configure; but for rounding in the units."""
    robot = load_robot(folder)
    truth, simulation = true_arm(robot)
    nominal = describe(robot, simulation)
    for true, meant in zip(truth.joints, nominal.joints, strict=True):
        assert dataclasses.replace(true, drive=None) == meant
    for true, meant in zip(truth.drives(), nominal.drives(), strict=True):
        for field in dataclasses.fields(true.make):
            one, other = getattr(true.make, field.name), getattr(meant.make, field.name)
            if field.name == "efforts":
                assert set(one) <= set(other)
            else:
                assert one is other or one == pytest.approx(other, rel=1e-12), field.name


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda d: d["drives"]["servo"]["quirks"].update(wobbles=True),
         r"yaml:\d+: drives.servo.quirks: unknown key `wobbles` \(allowed: needs_nmt"),
        (lambda d: d["joints"][0].update(drive="other"),
         r"joints\[0\] \(base\).drive: no drive `other`; there are: servo"),
        (lambda d: (d["drives"]["servo"].pop("motor_position", None), wrong_encoder(d, "motor")),
         r"joints\[0\] \(base\).encoder_errors\[0\].encoder: motor, but drives.servo has no motor"),
        (lambda d: wrong_encoder(d, "tacho"),
         r"encoder_errors\[0\].encoder: must be one of link, motor, not 'tacho'"),
        (lambda d: d["joints"][1].update(node=d["joints"][0]["node"]),
         r"yaml: joints\[1\] \(shoulder\).node: \d+ is also that of base"),
        (lambda d: d["joints"][1].update(name="base"),
         r"yaml: joints\[1\] \(base\).name: two joints have this name"),
        (lambda d: d["joints"][0].update(lower=2.0, upper=-1.0),
         r"yaml: joints\[0\] \(base\).lower: 2 rad must be less than upper \(-1\)"),
        (lambda d: d.update(initial_position={"base": 7.0}),
         r"yaml: initial_position.base: 7 rad is not between its end stops, -1.24 to 1.87 rad"),
        (lambda d: d["drives"]["servo"]["link_position"].update(counts=0),
         r"yaml: drives.servo.link_position.counts: must not be 0 per turn"),
        (lambda d: d.update(settings={"step_s": 1e-12}),
         r"settings.step_s: must be a number of at least 1e-05, not 1e-12"),
        (lambda d: d.update(initial_position={"thumb": 0.1}),
         r"initial_position.thumb: no such joint; there are: base"),
        (lambda d: d["drives"]["servo"]["link_position"].update(object=0x2999),
         r"cannot be simulated: object 0x2999:01 \(its link position\) is not in its EDS"),
        (lambda d: d["joints"][0].update(gear=0),
         r"joints\[0\] \(base\).gear: must be a number above 0"),
        (lambda d: d.pop("joints"), "the true arm is missing .* --write-truth"),
    ],
)  # fmt: skip
def test_a_truth_that_cannot_be_simulated_is_refused(folder, edit, says):
    change(folder, edit)
    with pytest.raises(ConfigurationError, match=says):
        true_arm(load_robot(folder))


def test_a_file_of_before_is_refused_with_the_words_to_change_it_and_kept(tmp_path):
    folder = shutil.copytree(ROMEO, tmp_path / "arm")
    old = "# mine\ninitial_position: {LElbowRoll: 0.3}\nsettings: {seed: 7}\n"
    (folder / "simulation.yaml").write_text(old)
    with pytest.raises(ConfigurationError, match="--write-truth"):
        true_arm(load_robot(folder))
    result = CliRunner().invoke(main, ["simulate", str(folder), "--write-truth"])
    assert result.output == f"wrote {folder / 'simulation.yaml'}\n"
    assert (folder / "simulation.yaml").read_text().startswith(old)
    assert (folder / "simulation.urdf").read_text() == (folder / "arm.urdf").read_text()
    truth, simulation = true_arm(load_robot(folder))
    assert simulation.settings.seed == 7
    assert truth.joints[2].initial_position == 0.3
    again = CliRunner().invoke(main, ["simulate", str(folder), "--write-truth"])
    assert again.exit_code == 78
    assert "never overwritten" in again.output
    assert "move simulation.yaml and simulation.urdf away first" in again.output


def test_drives_that_the_daemon_will_refuse_are_reported_with_a_remedy(folder):
    assert refused_drives(load_robot(folder), true_arm(load_robot(folder))[1]) == []
    before = (folder / "config.yaml").read_text()
    text, found = re.subn(r"rated_current_A: \S+", "rated_current_A: 1.75", before, count=1)
    assert found == 1
    (folder / "config.yaml").write_text(text)
    robot = load_robot(folder)
    first, which, way = refused_drives(robot, true_arm(robot)[1])
    assert "simulation.yaml" in first
    assert re.fullmatch(
        r"  base: rated_current_A is [\d.]+ here, and 1.75 in config.yaml", which
    ), which
    assert way.endswith(f"`contactd simulate {folder} --write-truth`")


def test_a_truth_cannot_be_written_of_setpoints_elsewhere(folder):
    (folder / "simulation.yaml").unlink()
    text = (folder / "config.yaml").read_text()
    sign = "    quick_stop_deceleration:\n"
    (folder / "config.yaml").write_text(text.replace(sign, f"{sign}      sign: -1\n"))
    result = CliRunner().invoke(main, ["simulate", str(folder), "--write-truth"])
    assert result.exit_code == 78
    assert "drives.servo.quick_stop_deceleration: 0x6085 with sign -1" in result.output
    assert not (folder / "simulation.urdf").exists()


def test_encoder_errors_of_the_file_are_what_the_daemon_reads(folder):
    error = {"encoder": "link", "order": 1, "amplitude": 0.004, "phase": 1.5708}
    change(folder, lambda data: data["joints"][1].update(encoder_errors=[error]))
    with true_rig(folder) as rig:
        rig.run(0.1)
        q = rig.arm.plant.q
        found = rig.samples.link_position - q
    assert found[1] == pytest.approx(0.004 * np.cos(q[1]), abs=1e-4)
    assert np.abs(np.delete(found, 1)).max() < 2e-4


@pytest.mark.parametrize("needs_reset", [True, False])
def test_a_drive_without_a_heartbeat_consumer_goes_on_without_a_master(folder, needs_reset):
    set_quirks(folder, no_heartbeat_consumer=not needs_reset)
    with true_rig(folder) as rig:
        rig.enable()
        rig.arm.advance(rig.arm.now + 0.5)  # no SYNC and no heartbeat meanwhile
        states = {drive.state for drive in rig.arm.drives}
    stopped = State.QUICK_STOP_ACTIVE if needs_reset else State.OPERATION_ENABLED
    assert states == {stopped}


def test_coarse_velocity_and_unfiltered_current(folder):
    set_quirks(folder, velocity_step=2.0, current_filter_ms=0.0)
    with true_rig(folder) as rig:
        arm = rig.arm
        gear = np.array([joint.gear for joint in arm.description.joints])
        one = np.linspace(0.001, 0.2, len(gear))
        readings = arm.sense(arm.plant.q, arm.plant.theta, one)
        unit = np.array([drive.make.measured_velocity_unit for drive in arm.drives])
        motor = np.array(readings.motor_velocity) * unit
        assert np.abs(motor / 2.0 - np.round(motor / 2.0)).max() < 0.01
        assert np.abs(motor - one * gear).max() < 1.6
        rig.enable()
        assert (np.array([drive.make.current_filter_ms for drive in arm.drives]) == 0.0).all()


def test_no_file_says_nothing(folder):
    (folder / "simulation.yaml").unlink()
    robot = load_robot(folder)
    assert read_simulation(robot).joints == []
    with pytest.raises(ConfigurationError, match="--write-truth"):
        true_arm(robot)


def test_an_arm_that_is_thrown_turns_faster_than_its_drives_can_say(folder):
    """A measurement of a drive stays at the end of its object, and the simulation goes on."""
    sheet = folder / "drive.eds"
    wide = r"(?s)(\[606C\].*?DataType=0x0*)4"
    text, found = re.subn(wide, r"\g<1>3", sheet.read_text(), count=1)
    assert found
    sheet.write_text(text)
    config = yaml.safe_load((folder / "config.yaml").read_text())
    config["drives"]["servo"]["motor_velocity"]["type"] = "INTEGER16"
    (folder / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
    with true_rig(folder) as rig:
        rig.enable()
        rig.arm.external_torque[0] = 100.0
        fastest = 0.0
        for _ in range(50):
            rig.run(0.01)
            fastest = max(fastest, *(abs(v) for v in rig.arm.plant.theta_dot))
        counts = {drive.objects.number(0x606C) for drive in rig.arm.drives}
        assert fastest > 32768 * 0.010471975511965978 / 80.0
        assert all(-32768 <= count <= 32767 for count in counts)
