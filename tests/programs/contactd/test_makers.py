"""Drives of ten makers by the facts of their EDS files: what is drafted, asked for, simulated, and
refused in which words."""

import re
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from bench.rigs.lockstep import DESK_ARM, lockstep_rig
from bench.rigs.makers import RIGHT, USABLE, Maker, makers, verdict, wrong
from bench.study.mistakes import reported
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from drivers.canopen.boot.data_sheet import load_data_sheet
from programs.contactd.contactd import main
from programs.contactd.drafts.drive import choices_of, drafted_drive
from programs.simulate.simulated_robot import supplied_values, true_arm
from simulator.truth import SimulationFile

ALL = makers()
ONE_ENCODER = ALL["nanotec_cl4e"].without(0x60E4, 0x60E5)


def new(folder: Path, maker: Maker, *words: str):
    eds = folder / "drive.eds"
    eds.write_text(maker.eds())
    urdf = str(DESK_ARM / "arm.urdf")
    command = ["new", str(folder / "mine"), "--urdf", urdf, "--eds", f"servo={eds}", *words]
    return CliRunner().invoke(main, command)


def line_of(folder: Path, quantity: str) -> str:
    (line,) = re.findall(rf" {quantity}: {{.*", (folder / "mine" / "config.yaml").read_text())
    return line


@pytest.mark.parametrize("name", ALL)
def test_objects_are_right_or_asked_for(name, tmp_path):
    assert wrong(ALL[name], tmp_path) == {}
    assert set(RIGHT) == set(ALL)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("maxon_epos4", "can be used if its manual has mode 9 (cyclic synchronous velocity), as "
         "0x6502 has no value here; with link_position and motor_position as you find them when "
         "you turn the motor (CHECK)"),
        ("nanotec_cl4e", "can be used with link_position and motor_position as you find them when "
         "you turn the motor (CHECK)"),
        ("elmo_gold", "can be used if its manual has mode 9 (cyclic synchronous velocity), as "
         "0x6502 has no value here; with half_gap 0, as nothing here is a link encoder (--object "
         "link_position=0x6064, if that is one); with link_position as you find them when you turn "
         "the motor (CHECK)"),
        ("yiyou_servo", "cannot be used, because without 0x6007:00 it cannot be configured to stop "
         "when the master falls silent"),
        ("technosoft_ipos", "cannot be used, because\n  without 0x1016:01 it cannot watch the "
         "master's heartbeat, and would move on when the daemon dies\n  its modes, 0x001F0065 in "
         "0x6502, lack mode 9, cyclic synchronous velocity (bit 8): where your firmware has it, "
         "correct 0x6502 in your copy of the EDS"),
    ],
)  # fmt: skip
def test_the_verdict(name, says, tmp_path):
    assert verdict(ALL[name], tmp_path) == says


@pytest.mark.parametrize("name", sorted(set(ALL) - set(USABLE)))
def test_a_refusal_has_reasons_and_leaves_nothing(name, tmp_path):
    result = new(tmp_path, ALL[name])
    assert result.exit_code == 78
    assert "drive.eds: cannot be used, because" in result.output
    assert " is missing\n" not in result.output
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize("maker", [*(ALL[name] for name in USABLE), ONE_ENCODER],
                         ids=lambda maker: maker.name)  # fmt: skip
def test_a_usable_drive_is_drafted_checked_and_rehearsed(maker, tmp_path):
    result = new(tmp_path, maker)
    assert result.exit_code == 0, result.output
    assert "servo: can be used" in result.output
    said = reported(tmp_path / "mine")
    assert (said.refused, said.lines) == (False, [])
    with lockstep_rig(tmp_path / "mine", described=lambda robot, _: true_arm(robot)[0]) as rig:
        rig.enable()
        rig.run(1.0)
        assert rig.tick.controller.machine.mode == "holding"


def test_a_current_is_no_threshold_and_runners_up_are_shown(tmp_path):
    assert new(tmp_path, ALL["maxon_epos4"]).exit_code == 0
    line = line_of(tmp_path, "current")
    assert "object: 0x30D1, subindex: 2, type: INTEGER32" in line
    assert "mA, which 32 bits suggest, are 0.001 / rated_current_A" in line
    assert line.endswith(
        "not taken: 0x30D1:01 'Current actual value averaged', 0x6077:00 'Torque actual value'"
    )
    assert "0x60E4:02 'Position actual value sensor 2'" in line_of(tmp_path, "link_position")


def test_units_of_the_eds_are_scales_that_are_asked_for(tmp_path):
    assert new(tmp_path, ALL["nanotec_cl4e"]).exit_code == 0
    drive = yaml.safe_load((tmp_path / "mine" / "config.yaml").read_text())["drives"]["servo"]
    assert drive["motor_position"]["scale"] == pytest.approx(0.1 * 0.017453292519943295)
    assert drive["motor_velocity"]["scale"] == pytest.approx(0.10471975511965977)
    line = line_of(tmp_path, "motor_position")
    assert "CHECK" in line
    assert "0.1 degrees by 0x60A8 (0xFF410000) as delivered, which can be changed" in line


@pytest.mark.parametrize("maker", [ALL["elmo_gold"], ONE_ENCODER], ids=["elmo", "nanotec"])
def test_without_a_link_encoder_none_is_drafted_nor_simulated(maker, tmp_path):
    assert new(tmp_path, maker).exit_code == 0
    line = line_of(tmp_path, "link_position")
    assert "object: 0x6064" in line
    assert "# CHECK: nothing here is a link encoder. 0x6064 is taken to be the motor's" in line
    written = yaml.safe_load((tmp_path / "mine" / "config.yaml").read_text())
    assert "motor_position" not in written["drives"]["servo"]
    assert written["estimator"]["motor_position"] == "integrated"
    assert {joint["half_gap"] for joint in written["joints"]} == {0}
    simulated = (tmp_path / "mine" / "simulation.yaml").read_text()
    assert (
        "# servo: nothing in its EDS is a link encoder, and this simulation has none" in simulated
    )
    assert yaml.safe_load(simulated)["drives"]["servo"]["link_encoder"] is False


def test_the_user_knows_of_a_link_encoder_on_0x6064(tmp_path):
    assert new(tmp_path, ONE_ENCODER, "--object", "link_position=0x6064").exit_code == 0
    assert "2 pi / counts per turn of the link's encoder" in line_of(tmp_path, "link_position")
    written = yaml.safe_load((tmp_path / "mine" / "config.yaml").read_text())
    # 0x6063 is the same encoder in its own counts.
    assert "motor_position" not in written["drives"]["servo"]
    assert all(joint["half_gap"] > 0 for joint in written["joints"])
    assert "link_encoder" not in (tmp_path / "mine" / "simulation.yaml").read_text()


def test_0x6064_beside_a_motors_encoder_may_be_the_links(tmp_path):
    (tmp_path / "drive.eds").write_text(ALL["zeroerr_edriver"].without(0x20A0).eds())
    choices = choices_of(load_data_sheet(tmp_path / "drive.eds"), {})
    assert choices["link_position"].chosen.where == (0x6064, 0)
    assert "which sensor is where" in choices["link_position"].chosen.doubt
    assert choices["motor_position"].chosen.where == (0x2240, 0)


@pytest.mark.parametrize(
    ("named", "says"),
    [
        ("servo.current=0x30D1:02", "object: 0x30D1, subindex: 2"),
        ("current=30D1:2", "object: 0x30D1, subindex: 2"),
        ("current=0x30B2", "'Current threshold for homing mode' can be written (access rww): a "
         "parameter, not a measurement; only config.yaml may name it"),
        ("current=0x30D1:07", "--object current=0x30D1:07: this EDS has no such object"),
        ("flux=0x30D1:01", "must be [NAME.]QUANTITY=INDEX[:SUB] in hexadecimal"),
        ("arm.current=0x30D1:01", "must be [NAME.]QUANTITY=INDEX[:SUB] in hexadecimal"),
        ("current=many", "must be [NAME.]QUANTITY=INDEX[:SUB] in hexadecimal"),
    ],
)  # fmt: skip
def test_objects_that_the_user_names(named, says, tmp_path):
    result = new(tmp_path, ALL["maxon_epos4"], "--object", named)
    if result.exit_code == 0:
        assert says in line_of(tmp_path, "current")
    else:
        assert says in " ".join(result.output.split())


def test_a_refusal_says_what_was_looked_at_and_how_to_name_it(tmp_path):
    (tmp_path / "drive.eds").write_text(ALL["maxon_epos4"].without(0x30D1, 0x30D2, 0x6077).eds())
    with pytest.raises(ConfigurationError) as refused:
        drafted_drive(load_data_sheet(tmp_path / "drive.eds"), "drive.eds")
    said = str(refused.value)
    assert "nothing in its EDS is surely its current or torque: 0x6078:00 is not there" in said
    assert "0x30B2:00 'Current threshold for homing mode' can be written (access rww)" in said
    assert "name it by --object current=0xINDEX:SUB, if its manual has one" in said


def test_the_check_says_that_a_measurement_can_be_written_and_that_modes_are_unknown(tmp_path):
    assert new(tmp_path, ALL["maxon_epos4"]).exit_code == 0
    config = tmp_path / "mine" / "config.yaml"
    text, found = re.subn(
        r"current: {object: 0x30D1, subindex: 2, type: INTEGER32",
        "current: {object: 0x30B2, type: UNSIGNED16", config.read_text(),
    )  # fmt: skip
    assert found == 1
    config.write_text(text)
    said = " ".join(CliRunner().invoke(main, ["check", str(tmp_path / "mine")]).output.split())
    assert (
        "0x30B2:00 (Current threshold for homing mode) can be written (access rww): a parameter, "
        "not a measurement, unless the manual says otherwise"
    ) in said
    assert "its EDS has no value in 0x6502: the manual says whether it has mode 9" in said


def test_the_simulation_says_what_it_supplied(tmp_path):
    assert new(tmp_path, ALL["maxon_epos4"]).exit_code == 0
    (described,) = true_arm_of(tmp_path / "mine")
    assert described.startswith("drive.eds gives no value for 6 objects; as CiA 301 and 402 ask ")
    for value in ("0x1000:00 (Device type) = 0x20192", "0x1018:01 (Vendor-ID) = 0xFB",
                  "0x1018:02 (Product code) = 0x60500000", "0x6502:00"):  # fmt: skip
        assert value in described


def true_arm_of(folder: Path) -> list[str]:
    description, simulation = true_arm(load_robot(folder))
    assert isinstance(simulation, SimulationFile)
    return supplied_values(description)
