"""Values that arming needs for each joint: identified, or known otherwise by hand and by name."""

import shutil
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT, lockstep_rig
from common.errors import ConfigurationError
from daemon.assembly import check_parameters, covered_range
from daemon.config.digests import fingerprint
from daemon.config.evidence import objections
from daemon.config.identified import (
    Entry,
    FrictionEntry,
    GapEntry,
    Identified,
    IdentifiedJoint,
    SeenEntry,
    ThresholdsEntry,
    WiringEntry,
    identified_keys,
    write_identified,
)
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration, Friction, Levels
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Check

DAY = {"date": "2026-01-02T03:04:05+00:00", "log": "0"}
ENTRIES: dict[str, Entry] = {
    "wiring": WiringEntry(**DAY, follows=1.0),
    "gap": GapEntry(**DAY, half_gap=0.02, confidence=0.001),
    "friction": FrictionEntry(
        **DAY, friction=Friction(motor_coulomb=0.3), errors={}, r2=1.0, condition=1.0
    ),
    "thresholds": ThresholdsEntry(
        **DAY, thresholds=Levels(contact=0.4, collision=3.0), per_hour=1.0, largest=0.3,
        seen=SeenEntry(speed=1.0, lower=-1.0, upper=1.0),
    ),
}  # fmt: skip
COMMANDS = {
    "wiring": "`contactd identify wiring`",
    "gap": "`contactd identify gap JOINT`",
    "friction": "`contactd identify friction`",
    "thresholds": "`contactd identify thresholds`",
}


def arm(folder: Path, known: str = "", *steps: str) -> Robot:
    """The single joint with this `known`, and these steps identified."""
    for name in ("romeo_left_arm", "single_joint"):
        shutil.copytree(ROMEO.parent / name, folder / name, dirs_exist_ok=True)
    place = folder / "single_joint"
    (place / "identified.yaml").unlink()
    config = place / "config.yaml"
    lines = config.read_text().splitlines(keepends=True)
    (at,) = (i for i, line in enumerate(lines) if "known:" in line)
    lines[at] = f"    known: {known}\n" if known else ""
    config.write_text("".join(lines))
    robot = load_robot(place)
    joint = IdentifiedJoint(serial=1, **{step: ENTRIES[step] for step in steps})
    digest = fingerprint(robot.configuration, robot.urdf)
    found = Identified(configuration=digest, joints={"joint": joint})
    write_identified(place / "identified.yaml", found)
    return load_robot(place)


def refusals(robot: Robot) -> list[str]:
    """Reasons not to arm for want of a step."""
    against = objections(robot.identified, robot.configuration, robot.urdf, {"joint": 1})
    parameters = check_parameters(robot)
    return against + ([] if parameters.passed else parameters.text.split("; the "))


@pytest.mark.parametrize("missing", ENTRIES)
@pytest.mark.parametrize("otherwise", [False, True])
def test_each_step_is_needed(missing: str, otherwise: bool, tmp_path: Path) -> None:
    known = f"{{{missing}: of the data sheet}}" if otherwise else ""
    robot = arm(tmp_path, known, *(step for step in ENTRIES if step != missing))
    reasons = refusals(robot)
    assert bool(reasons) != otherwise
    if not otherwise:
        (reason,) = reasons
        assert f"{missing} of joint" in reason
        assert COMMANDS[missing] in reason
    elif missing != "wiring":
        assert f"{missing} of all: of the data sheet" in check_parameters(robot).text


def test_all_that_is_missing_is_named(tmp_path: Path) -> None:
    reasons = refusals(arm(tmp_path))
    for command, reason in zip(COMMANDS.values(), reasons, strict=True):
        assert command in reason


@pytest.mark.parametrize(("drive", "refused"), [(1, False), (2, True), (None, True)])
def test_a_wiring_that_is_known_makes_no_other_drive_this_one(
    tmp_path: Path, drive: int | None, refused: bool
) -> None:
    robot = arm(tmp_path, "{wiring: by hand}", "gap", "friction", "thresholds")
    against = objections(robot.identified, robot.configuration, robot.urdf, {"joint": drive})
    assert against == [f"joint was identified on drive 1, this is drive {drive}"] * refused


def test_an_identified_value_is_not_listed_as_known_otherwise(tmp_path: Path) -> None:
    robot = arm(tmp_path, "{gap: of the data sheet, friction: by the maker}", "gap", "thresholds")
    assert check_parameters(robot).text == "known otherwise: friction of all: by the maker"


def test_all_identified_needs_no_known(tmp_path: Path) -> None:
    text = "gap, friction and thresholds of every joint are identified"
    check = check_parameters(arm(tmp_path, "", *ENTRIES))
    assert check == Check(name="parameters", passed=True, text=text)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ("{gap: ''}", "joints[0] (joint).known"),
        ("{speed: measured}", "known: unknown key `speed` (allowed: friction, gap, masses, "),
        ("[gap]", "joints[0] (joint).known: must be a group of fields, not a list"),
        ("{gap: true}", "must be text, not true"),
    ],
)
def test_an_invalid_statement_of_known_is_refused(known: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        arm(tmp_path, known)
    assert words in str(caught.value)


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM, SINGLE_JOINT])
def test_every_shipped_arm_states_how_its_values_are_known(folder: Path) -> None:
    check = check_parameters(load_robot(folder))
    assert check.passed
    assert check.text.startswith("known otherwise: gap of all: as simulated")


def test_text_of_known_is_printed_without_control_characters(tmp_path: Path) -> None:
    robot = arm(tmp_path, '{gap: "\\e[2J"}', "wiring", "friction", "thresholds")
    assert "gap of all: ?[2J" in check_parameters(robot).text


def test_joints_are_named_where_they_differ() -> None:
    robot = load_robot(DESK_ARM)
    column, swing = robot.configuration.joints
    joints = [
        msgspec.structs.replace(column, known={"gap": "a\x1b[2Jb", "friction": "maker"}),
        msgspec.structs.replace(swing, known={"friction": "maker"}),
    ]
    c = msgspec.structs.replace(robot.configuration, joints=joints)
    check = check_parameters(replace(robot, configuration=c))
    assert not check.passed
    assert "the gap of swing not identified" in check.text
    assert check.text.endswith("identified since is used when the files are read anew")
    assert "the thresholds of column, swing not identified" in check.text
    assert "friction" not in check.text.partition("the thresholds")[0]


def test_without_them_the_arm_runs_and_is_not_armed() -> None:
    """Friction is identified in motion: the links are trusted once the wiring was checked."""

    def ask(c: Configuration) -> Configuration:
        (joint,) = c.joints
        return msgspec.structs.replace(c, joints=[msgspec.structs.replace(joint, known={})])

    with lockstep_rig(SINGLE_JOINT, configure=ask) as rig:
        rig.enable()
        refused = rig.permit()
        assert len(refused) == 1
        assert "the gap of joint not identified" in refused[0]
        rig.request(Event.START)
        rig.run(1.0)
        assert rig.mode is Mode.TRACKING


def test_places_of_what_was_identified(tmp_path: Path) -> None:
    robot = arm(tmp_path, "", *ENTRIES)
    c, found = robot.configuration, robot.identified

    def keys(*path: str) -> list[str | int]:
        return identified_keys(["joints", 0, *path], c, found)

    assert keys("half_gap") == ["joints", "joint", "gap", "half_gap"]
    for step, field in (("friction", "gap_viscous"), ("thresholds", "contact")):
        assert keys(step, field) == ["joints", "joint", step, step, field]
    assert keys("rotor_inertia") == []  # the current did not show it
    assert keys("torque_constant") == []
    assert identified_keys(["urdf"], c, found) == []
    assert identified_keys(["joints", 0, "half_gap"], c, None) == []


@pytest.mark.parametrize(
    ("known", "least", "steps", "share"),
    [
        ("{thresholds: by hand}", "", (), 1.0),
        ("{thresholds: by hand}", ", least: 0.25", (), 0.5),
        ("{gap: by hand}", "", (), 0.2),
        ("{thresholds: by hand}", "", ("thresholds",), 1.0),
        ("{gap: by hand}", "", ("thresholds",), 0.2),
        ("{gap: by hand}", ", least: 0.1", ("thresholds",), 0.25),
    ],
)
def test_learning_does_not_lower_a_stated_level(
    tmp_path: Path, known: str, least: str, steps: tuple[str, ...], share: float
) -> None:
    folder = arm(tmp_path, known, *steps).folder
    config = folder / "config.yaml"
    text = config.read_text()
    assert ", least: 0.1}" in text
    config.write_text(text.replace(", least: 0.1}", f"{least}}}"))
    (joint,) = load_robot(folder).configuration.joints
    assert joint.least_share == pytest.approx(share)


def test_a_stated_level_stays_in_force_beside_an_identified_one(tmp_path: Path) -> None:
    robot = arm(tmp_path, "{thresholds: by hand}", *ENTRIES)
    c = robot.configuration
    assert (c.joints[0].thresholds.contact, c.joints[0].half_gap) == (0.5, 0.02)
    text = "known otherwise: thresholds of all: by hand (the identified ones are not used)"
    assert check_parameters(robot).text == text
    assert identified_keys(["joints", 0, "thresholds", "contact"], c, robot.identified) == []
    assert covered_range(robot).speed > 1.0
    assert covered_range(arm(tmp_path, "", *ENTRIES)).speed == 1.0


@pytest.mark.parametrize(
    ("known", "least", "refusal"),
    [
        ("", "0.09", ""),  # a fifth of the identified 0.4, not of the 0.5 beside it
        ("", "0.01", ""),  # learning leaves more
        ("", "0.45", "at most 0.4 Nm, contact of identified.yaml"),
        ("{thresholds: by hand}", "0.45", ""),
        ("{thresholds: by hand}", "0.09", "0.1 to 0.5 Nm: 0.2 to 1 times contact"),
        ("{thresholds: by hand}", "0.51", "0.1 to 0.5 Nm: 0.2 to 1 times contact"),
    ],
)
def test_a_floor_fits_the_level_in_force(tmp_path, known: str, least: str, refusal: str) -> None:
    config = arm(tmp_path, known, "thresholds").folder / "config.yaml"
    config.write_text(config.read_text().replace("least: 0.1}", f"least: {least}}}"))
    place = f"{config}:33: joints[0] (joint).thresholds.least: {least} must be "
    with pytest.raises(ConfigurationError) if refusal else nullcontext() as caught:
        load_robot(config)
    assert not refusal or str(caught.value) == place + refusal
