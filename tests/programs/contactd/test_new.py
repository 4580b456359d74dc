"""`contactd new`: a draft that can be checked and rehearsed at once, from URDF and EDS alone."""

import re
import shutil
from pathlib import Path

import pytest
import yaml

from bench.rigs.generated_arms import generate
from bench.rigs.generated_makes import MAKES
from bench.rigs.lockstep import DESK_ARM, ROMEO
from bench.study.mistakes import reported
from tests.golden_words import same_words
from tests.programs.contactd.drafting import GOLDEN, config_of, contactd, each, rehearsal

EACH_MAKE = pytest.mark.parametrize("seed", range(len(MAKES)), ids=[make.name for make in MAKES])


def new(folder: Path, urdf: Path, *sheets: object):
    return contactd("new", folder, "--urdf", urdf, *each("--eds", *sheets))


def new_of_texts(folder: Path, arm: Path, urdf: str = "", eds: str = ""):
    """Result of `new` for folder/mine: a shipped arm with another URDF or data sheet."""
    (folder / "arm.urdf").write_text(urdf or (arm / "arm.urdf").read_text())
    (folder / "drive.eds").write_text(eds or (arm / "drive.eds").read_text())
    return new(folder / "mine", folder / "arm.urdf", folder / "drive.eds")


def drafted(folder: Path, arm: Path, **texts: str):
    """Configuration that `new_of_texts` drafts."""
    result = new_of_texts(folder, arm, **texts)
    assert result.exit_code == 0, result.output
    return config_of(folder / "mine")


def in_millimetres(urdf: str) -> str:
    return re.sub(
        r'(?<=<origin )xyz="([^"]*)"',
        lambda found: f'xyz="{" ".join(f"{float(x) * 1e3:g}" for x in found[1].split())}"',
        urdf,
    )


@pytest.fixture
def given(tmp_path: Path):
    """Writes what an owner has of the arm of a seed, and drafts a folder from it."""

    def draft(seed: int) -> Path:
        arm = generate(seed)
        desk = tmp_path / "desk"
        desk.mkdir()
        (desk / "arm.urdf").write_text(arm.urdf)
        (desk / "drive.eds").write_text(arm.make.eds())
        result = new(tmp_path / "mine", desk / "arm.urdf", f"servo={desk / 'drive.eds'}")
        assert result.exit_code == 0, result.output
        assert "lines with CHECK hold guesses" in result.output
        return tmp_path / "mine"

    return draft


@EACH_MAKE
def test_the_draft_has_the_objects_of_the_data_sheet_and_passes_the_check(seed, given):
    folder, arm = given(seed), generate(seed)
    said = reported(folder)
    assert (said.refused, said.lines) == (False, [])
    written = config_of(folder)
    assert [joint["name"] for joint in written["joints"]] == list(arm.names)
    drive = written["drives"]["servo"]
    for name, quantity in arm.make.quantities.items():
        found = drive[name]
        assert (found["object"], found.get("subindex", 0), found["type"]) == (
            quantity.index, quantity.subindex, quantity.type,
        ), name  # fmt: skip
    motor_position = arm.make.quantities.get("motor_position")
    if motor_position and motor_position.index == 0x6064:
        assert drive["motor_position"]["scale"] == motor_position.scale
    if arm.make.fixed_pdos:
        assert drive["tpdo"] == {n: list(e) for n, e in arm.make.tpdo.items()}
        assert drive["rpdo"] == {n: list(e) for n, e in arm.make.rpdo.items()}


@EACH_MAKE
def test_words_of_a_draft_of_each_make(seed, given):
    """Guesses of a data sheet are marked CHECK, those of the URDF name the step that finds them."""
    words = (given(seed) / "config.yaml").read_text()
    same_words(GOLDEN / f"new_{MAKES[seed].name}.txt", words)


def test_words_of_drives_of_several_makes(tmp_path):
    """All are there, and the choice is marked at each joint."""
    one, other = (tmp_path / f"{MAKES[i].name}.eds" for i in (0, 4))
    one.write_text(MAKES[0].eds())
    other.write_text(MAKES[4].eds())
    result = new(tmp_path / "mine", ROMEO / "arm.urdf", one, f"small={other}")
    assert result.exit_code == 0, result.output
    words = result.output + (tmp_path / "mine" / "config.yaml").read_text()
    same_words(GOLDEN / "new_of_two_makes.txt", words.replace(str(tmp_path), "HERE"))
    assert reported(tmp_path / "mine").lines == []


def test_an_object_that_cannot_be_mapped_is_not_chosen(tmp_path):
    text = (ROMEO / "drive.eds").read_text()
    text, count = re.subn(r"(?s)(\[60E4sub1\].*?PDOMapping=)1", r"\g<1>0", text, count=1)
    assert count
    drive = drafted(tmp_path, ROMEO, eds=text)["drives"]["drive"]
    assert drive["link_position"]["object"] == 0x6064
    assert "motor_position" not in drive


@pytest.mark.parametrize("seed", [0, 3])
def test_the_draft_can_be_rehearsed_at_once(seed, given):
    with rehearsal(given(seed)) as rig:
        rig.run(1.0)
        assert rig.tick.controller.machine.mode == "holding"


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM], ids=lambda f: f.name)
def test_shipped_arms_can_be_drafted(folder, tmp_path):
    assert list(drafted(tmp_path, folder)["drives"]) == ["drive"]
    assert reported(tmp_path / "mine").lines == []


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine").mkdir()
    result = new_of_texts(tmp_path, ROMEO)
    assert result.exit_code == 78
    assert "exists: it is never overwritten" in result.output
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda u, e: (re.sub('type="revolute"', 'type="fixed"', u), e), "no joint moves"),
        (lambda u, e: (u.replace('upper="2.22041"', 'upper="-3"'), e),
         "line 1[0-9]: joint 'LShoulderPitch' has limits .* lower must be less than upper"),
        (lambda u, e: (u.replace("</robot>", ""), e), "arm.urdf: not XML"),
        (lambda u, e: (re.sub(r"(?s)<inertial>.*?</inertial>", "", u), e), "has a mass"),
        (lambda u, e: (u, re.sub(r"\[60FF\].*?\n\n", "", e, flags=re.DOTALL)),
         "cannot be used, because no object in its EDS is certain to be its target_velocity: "
         "0x60FF:00 is missing; name it by --object target_velocity=0xINDEX:SUB"),
        (lambda u, e: (u, "nothing"), "not a readable EDS"),
        (lambda u, e: (in_millimetres(u), e),
         "arm.urdf: joint '.*' would need a motor of .* Nm, at most 3000 is allowed: are masses"
         "(.|\n)*arm.urdf, line [0-9]+: joint 'LElbowRoll': its <origin> is .* m .*: in mm?"),
        (lambda u, e: (re.sub(r'<mass value="([^"]+)"', r'<mass value="\g<1>e3"', u), e),
         "arm.urdf: joint '.*' would need a motor of .* Nm(.|\n)*its inertia .* tungsten"),
        (lambda u, e: (u.replace('upper="2.22041"', 'upper="two"'), e),
         "arm.urdf: joint 'LShoulderPitch', line 1[0-9]: <limit upper=\"two\">: must be one"),
        (lambda u, e: (u.replace('xyz="', 'xyz="left ', 1), e), "must be three finite numbers"),
        *((lambda u, e, kind=kind: (u.replace('type="revolute"', f'type="{kind}"', 1), e),
           f"line 1[0-9]: joint 'LShoulderPitch' is {kind}: a joint .* must be `revolute`")
          for kind in ("prismatic", "continuous", "floating")),
        (lambda u, e: (u, re.sub(r"\[6007\].*?\n\n", "", e, flags=re.DOTALL)),
         "drive.eds: cannot be used, because without 0x6007:00 it cannot be configured to stop "
         "when the master falls silent\n"),
    ],
)  # fmt: skip
def test_a_draft_of_wrong_files_is_refused_and_nothing_is_left(edit, says, tmp_path):
    texts = edit((ROMEO / "arm.urdf").read_text(), (ROMEO / "drive.eds").read_text())
    result = new_of_texts(tmp_path, ROMEO, *texts)
    assert result.exit_code == 78, result.output
    assert re.search(says, result.output), result.output
    assert not (tmp_path / "mine").exists()


def test_limits_in_degrees_are_reported_at_once(tmp_path):
    urdf = (DESK_ARM / "arm.urdf").read_text().replace('lower="-1.6" upper="1.6"',
                                                       'lower="-92" upper="92"')  # fmt: skip
    result = new_of_texts(tmp_path, DESK_ARM, urdf)
    assert result.exit_code == 0, result.output
    assert "arm.urdf, line 11: joint 'column': its <limit> of -92 to 92 rad" in result.output


def test_the_check_reports_how_many_guesses_are_left(given):
    folder = given(0)
    config = folder / "config.yaml"
    marked = config.read_text().count("# CHECK")
    for left in (marked, marked - 1, 0):
        kept = config.read_text().split("\n")
        while sum("# CHECK" in line for line in kept) > left:
            i = next(i for i, line in enumerate(kept) if "# CHECK" in line)
            kept[i] = kept[i].partition("# CHECK")[0]
        config.write_text("\n".join(kept))
        said = contactd("check", folder).output
        assert (f"{left} lines still hold guesses (CHECK)" in said) is (left > 0), said
        assert ("guesses" in said) is (left > 0)


def test_a_drive_without_cyclic_velocity_is_refused_and_the_check_reports_it(tmp_path):
    drafted(tmp_path, DESK_ARM)
    eds = tmp_path / "mine" / "drive.eds"
    text, found = re.subn(r"(?s)(\[6502\].*?DefaultValue=)\w+", r"\g<1>0xA5", eds.read_text())
    assert found == 1
    eds.write_text(text)
    refused = new(tmp_path / "other", DESK_ARM / "arm.urdf", eds)
    assert refused.exit_code == 78
    assert "its modes, 0x000000A5 in 0x6502, lack mode 9" in " ".join(refused.output.split())
    said = " ".join(contactd("check", tmp_path / "mine").output.split())
    assert "drives.drive.eds: drive.eds has 0x000000A5 in 0x6502, without bit 8 (mode 9" in said


def test_a_sheet_given_again_is_of_the_next_joint_too(tmp_path):
    sheets = [f"{name}={ROMEO / 'drive.eds'}" for name in ("big", "big", "small")]
    assert new(tmp_path / "mine", ROMEO / "arm.urdf", *sheets).exit_code == 0
    of_joint = [joint["wiring"]["profile"] for joint in config_of(tmp_path / "mine")["joints"]]
    assert of_joint == ["big"] * 2 + ["small"] * 5
    truth = yaml.safe_load((tmp_path / "mine" / "simulation.yaml").read_text())
    assert not any({} in joint.values() for joint in truth["joints"])


def test_two_drives_of_one_name_and_no_urdf_are_refused(tmp_path):
    urdf, eds, other = ROMEO / "arm.urdf", ROMEO / "drive.eds", DESK_ARM / "drive.eds"
    twice = new(tmp_path / "mine", urdf, eds, f"drive={other}")
    assert (twice.exit_code, "two drives have the same name" in twice.output) == (78, True)
    missing = new(tmp_path / "mine", tmp_path / "none.urdf", eds)
    assert (missing.exit_code, "cannot be read" in missing.output) == (78, True)


@pytest.mark.parametrize(
    ("folder", "urdf", "sheets", "says"),
    [
        ("mine", "arm.urdf", ["a=one/drive.eds", "b=other/drive.eds"], "both are copied to one"),
        ("mine", "config.yaml", ["one/drive.eds"], "config.yaml is generated"),
        ("mine", "simulation.urdf", ["one/drive.eds"], "simulation.urdf is generated"),
        ("mine", "arm.urdf", ["=one/drive.eds"], "--eds =.*: must be NAME=FILE"),
        ("mine", "arm.urdf", [f"{i}=one/drive.eds" for i in range(8)], "has only 7 joints"),
        ("nowhere", "arm.urdf", ["one/drive.eds"], "nowhere exists: it is never overwritten"),
        ("arm.urdf/mine", "arm.urdf", ["one/drive.eds"], "mine cannot be created: Not a directory"),
    ],
)
def test_files_that_would_overwrite_others_are_refused(
    folder, urdf, sheets, says, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for name in ("arm.urdf", "config.yaml", "simulation.urdf"):
        shutil.copy(ROMEO / "arm.urdf", tmp_path / name)
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        shutil.copy(ROMEO / "drive.eds", tmp_path / name)
    (tmp_path / "nowhere").symlink_to(tmp_path / "gone")
    result = new(Path(folder), Path(urdf), *sheets)
    assert result.exit_code == 78, result.output
    assert re.search(says, " ".join(result.output.split())), result.output
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    "name", ["on", "1e3", "Gelenk ä", "\N{ROBOT FACE}", "a'b#c", "a\nb: 1", "a\x85b", "a\u202eb"]
)
def test_a_joint_may_have_any_name(name, tmp_path):
    urdf = (DESK_ARM / "arm.urdf").read_text()
    attribute = "".join(f"&#{ord(character)};" for character in name)
    written = drafted(tmp_path, DESK_ARM, urdf=urdf.replace('"column"', f'"{attribute}"'))
    assert [joint["name"] for joint in written["joints"]] == [name, "swing"]


def test_a_makers_own_current_is_a_guess_and_the_demand_is_not_chosen(tmp_path):
    text = (DESK_ARM / "drive.eds").read_text()
    text = re.sub(r"(?s)\[6077\].*?\n\n", "", text)
    for index, name in ((0x2010, "Motor current demand"), (0x2011, "Motor current actual")):
        text += (
            f"\n[{index:X}]\nParameterName={name}\nObjectType=0x7\nDataType=0x3\n"
            "AccessType=ro\nPDOMapping=1\n"
        )
    drafted(tmp_path, DESK_ARM, eds=text)
    (line,) = re.findall(r".*current: {.*", (tmp_path / "mine" / "config.yaml").read_text())
    assert "0x2011" in line
    assert "# CHECK" in line
    assert line.endswith("mA are 0.001 / rated_current_A")


def test_fixed_pdos_that_repeat_an_object_are_not_used(tmp_path):
    """As makers fix them: the statusword in each."""
    text = (DESK_ARM / "drive.eds").read_text()
    for number, objects in enumerate(
        ((0x60410010, 0x60770010), (0x60640020, 0x60690010), (0x60410010, 0x60640020))
    ):
        for sub, value in enumerate((2, *objects)):
            section = rf"(?s)(\[1A0{number}sub{sub}\].*?AccessType=)rw(.*?DefaultValue=)\w+"
            text, found = re.subn(section, rf"\g<1>const\g<2>0x{value:X}", text, count=1)
            assert found
    expected = {"1": ["statusword", "torque"], "2": ["link_position", "motor_velocity"]}
    assert drafted(tmp_path, DESK_ARM, eds=text)["drives"]["drive"]["tpdo"] == expected


def test_a_resolution_that_is_no_number_is_ignored(tmp_path):
    text = (ROMEO / "drive.eds").read_text()
    text = re.sub(r"(?s)\[608F(sub[0-2])?\].*?\n\n", "", text)
    text += "\n[608F]\nParameterName=Resolution\nObjectType=0x9\nSubNumber=3\n"
    for sub, kind, value in ((0, "0x5", "2"), (1, "0x9", "many"), (2, "0x9", "one")):
        text += (
            f"\n[608Fsub{sub}]\nParameterName=s\nObjectType=0x7\nDataType={kind}\n"
            f"AccessType=ro\nDefaultValue={value}\n"
        )
    drafted(tmp_path, ROMEO, eds=text)
