"""Drives of ten makers by the facts of their EDS files: what is drafted, asked for, simulated, and
refused in which words."""

import re
from pathlib import Path

import pytest

from bench.rigs.lockstep import DESK_ARM
from bench.rigs.makers import RIGHT, USABLE, Maker, makers, wrong
from bench.study.mistakes import reported
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from drivers.canopen.boot.data_sheet import load_data_sheet
from programs.contactd.drafts.drive import choices_of, drafted_drive
from programs.simulate.simulated_robot import supplied_values, true_arm
from simulator.truth import SimulationFile
from tests.golden_words import same_words
from tests.programs.contactd.drafting import GOLDEN, config_of, contactd, rehearsal

ALL = makers()
ONE_ENCODER = ALL["nanotec_cl4e"].without(0x60E4, 0x60E5)


def new(folder: Path, maker: Maker, *words: str):
    eds = folder / "drive.eds"
    eds.write_text(maker.eds())
    urdf = DESK_ARM / "arm.urdf"
    return contactd("new", folder / "mine", "--urdf", urdf, "--eds", f"servo={eds}", *words)


def line_of(folder: Path, quantity: str) -> str:
    (line,) = re.findall(rf" {quantity}: {{.*", (folder / "mine" / "config.yaml").read_text())
    return line


@pytest.mark.parametrize("name", ALL)
def test_objects_are_right_or_asked_for(name, tmp_path):
    assert wrong(ALL[name], tmp_path) == {}
    assert set(RIGHT) == set(ALL)


@pytest.mark.parametrize("name", [*ALL, "one encoder"])
def test_words_of_a_refusal_or_a_draft(name, tmp_path):
    """A refusal with its reasons, which leaves nothing; or the draft: runners-up, units of the EDS,
    that nothing is a link encoder, and what the simulation supplied."""
    result = new(tmp_path, ALL.get(name, ONE_ENCODER))
    mine = tmp_path / "mine"
    said = [result.output]
    assert (result.exit_code, mine.exists()) in ((0, True), (78, False))
    if mine.exists():
        description, simulation = true_arm(load_robot(mine))
        assert isinstance(simulation, SimulationFile)
        said += [(mine / name).read_text() for name in ("config.yaml", "simulation.yaml")]
        said += supplied_values(description)
    words = "\n".join(said).replace(str(tmp_path), "HERE")
    same_words(GOLDEN / f"new_{name.replace(' ', '_')}.txt", words)


@pytest.mark.parametrize("maker", [*(ALL[name] for name in USABLE), ONE_ENCODER],
                         ids=lambda maker: maker.name)  # fmt: skip
def test_a_usable_drive_is_drafted_checked_and_rehearsed(maker, tmp_path):
    result = new(tmp_path, maker)
    assert result.exit_code == 0, result.output
    assert "servo: can be used" in result.output
    said = reported(tmp_path / "mine")
    assert (said.refused, said.lines) == (False, [])
    with rehearsal(tmp_path / "mine") as rig:
        rig.run(1.0)
        assert rig.tick.controller.machine.mode == "holding"


def test_a_link_encoder_on_0x6064_can_be_named_by_the_user(tmp_path):
    assert new(tmp_path, ONE_ENCODER, "--object", "link_position=0x6064").exit_code == 0
    assert "2 pi / counts per turn of the link's encoder" in line_of(tmp_path, "link_position")
    written = config_of(tmp_path / "mine")
    # 0x6063 is the same encoder in its own counts.
    assert "motor_position" not in written["drives"]["servo"]
    assert all(joint["half_gap"] > 0 for joint in written["joints"])
    assert "link_encoder" not in (tmp_path / "mine" / "simulation.yaml").read_text()


def test_0x6064_beside_a_motors_encoder_is_taken_for_the_links_with_doubt(tmp_path):
    (tmp_path / "drive.eds").write_text(ALL["zeroerr_edriver"].without(0x20A0).eds())
    choices = choices_of(load_data_sheet(tmp_path / "drive.eds"), {})
    assert choices["link_position"].chosen.where == (0x6064, 0)
    assert "which sensor it is" in choices["link_position"].chosen.doubt
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
def test_an_object_that_the_user_names_is_drafted_or_refused(named, says, tmp_path):
    result = new(tmp_path, ALL["maxon_epos4"], "--object", named)
    if result.exit_code == 0:
        assert says in line_of(tmp_path, "current")
    else:
        assert says in " ".join(result.output.split())


def test_a_refusal_lists_the_objects_considered_and_the_option_to_name_one(tmp_path):
    (tmp_path / "drive.eds").write_text(ALL["maxon_epos4"].without(0x30D1, 0x30D2, 0x6077).eds())
    with pytest.raises(ConfigurationError) as refused:
        drafted_drive(load_data_sheet(tmp_path / "drive.eds"), "drive.eds")
    said = str(refused.value)
    assert (
        "no object in its EDS is certain to be its current or torque: 0x6078:00 is missing" in said
    )
    assert "0x30B2:00 'Current threshold for homing mode' can be written (access rww)" in said
    assert "name it by --object current=0xINDEX:SUB, if its manual has one" in said


def test_the_check_reports_a_writable_measurement_and_unknown_modes(tmp_path):
    assert new(tmp_path, ALL["maxon_epos4"]).exit_code == 0
    config = tmp_path / "mine" / "config.yaml"
    text, found = re.subn(
        r"current: {object: 0x30D1, subindex: 2, type: INTEGER32",
        "current: {object: 0x30B2, type: UNSIGNED16", config.read_text(),
    )  # fmt: skip
    assert found == 1
    config.write_text(text)
    said = " ".join(contactd("check", tmp_path / "mine").output.split())
    assert (
        "0x30B2:00 (Current threshold for homing mode) can be written (access rww): a parameter, "
        "not a measurement, unless the manual says otherwise"
    ) in said
    assert "its EDS has no value for 0x6502: see the manual for mode 9" in said
