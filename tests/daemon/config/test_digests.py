"""A change voids only what depends on it."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
import yaml

from bench.rigs.generated_arms import in_yaml
from bench.rigs.lockstep import ROMEO
from daemon.config.digests import digests, fingerprint
from daemon.config.evidence import objections, outdated, parameters_missing
from daemon.config.identified import (
    EncodersEntry,
    Entry,
    FrictionEntry,
    GapEntry,
    Identified,
    MassesEntry,
    ThresholdsEntry,
    WiringEntry,
    ZeroEntry,
    write_identified,
)
from daemon.config.load import Robot, load_robot
from daemon.config.schema import ArmingStep, Friction, Levels
from drivers.wiring import Harmonic
from estimator.body_inertia import BodyInertia
from programs.identify.merge import merged

DAY = {"date": "2026-01-02T03:04:05+00:00", "log": "0"}
BODY = BodyInertia(mass=1.1, com=(0.0, 0.0, -0.2), inertia=(0.02, 0.0, 0.0, 0.02, 0.0, 0.001))
ENTRIES: dict[ArmingStep, Entry] = {
    "wiring": WiringEntry(**DAY, follows=1.0),
    "gap": GapEntry(**DAY, half_gap=0.1, confidence=0.001),
    "masses": MassesEntry(**DAY, body=BODY, by_urdf=0.3, by_this=0.1),
    "friction": FrictionEntry(
        **DAY, friction=Friction(motor_coulomb=0.3), errors={}, r2=1.0, condition=1.0
    ),
    "thresholds": ThresholdsEntry(
        **DAY, thresholds=Levels(contact=0.4, collision=3.0), per_hour=1.0, largest=0.3
    ),
}
ALL = set(ENTRIES)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The single joint, with all steps passed."""
    for name in ("romeo_left_arm", "single_joint"):
        shutil.copytree(ROMEO.parent / name, tmp_path / name, dirs_exist_ok=True)
    place = tmp_path / "single_joint"
    (place / "identified.yaml").unlink()
    edit(place / "config.yaml", r"(?m)^ *known:.*\n", "")
    for step, entry in ENTRIES.items():
        identify(place, step, entry)
    return place


def identify(place: Path, step: ArmingStep, entry: Entry) -> None:
    """Write the entry of the step for every joint into identified.yaml."""
    robot = load_robot(place)
    names = robot.configuration.joint_names
    found = merged(robot, step, dict.fromkeys(names, entry), dict.fromkeys(names, 1))
    write_identified(place / "identified.yaml", found)


def void(robot: Robot) -> set[str]:
    c, urdf = robot.configuration, robot.urdf
    return {step for step in ENTRIES if outdated(step, robot.identified, c, urdf)}


def edit(path: Path, pattern: str, new: str, count: int = 1) -> None:
    text, done = re.subn(pattern, new, path.read_text(), count=count)
    assert done >= 1, pattern
    path.write_text(text)


@pytest.mark.parametrize(
    ("file", "pattern", "new", "expected"),
    [
        ("config.yaml", r"gear: [\d.]+", "gear: 77.0", ALL),
        ("config.yaml", r"(period_ms: )[\d.]+", r"\g<1>20", ALL),
        ("config.yaml", r"torque_constant: [\d.]+", "torque_constant: 3.1", ALL - {"gap"}),
        ("config.yaml", r"admittance_gain: [\d.]+", "admittance_gain: 0.05", set()),
        ("arm.urdf", r'(<mass value=")[\d.]+', r"\g<1>1.05", {"masses", "friction", "thresholds"}),
        ("identified.yaml", r"(mass: )[\d.]+", r"\g<1>1.05", {"friction", "thresholds"}),
        ("arm.urdf", r'(<axis xyz=")[^"]+', r"\g<1>1 0 0", ALL),
        ("arm.urdf", r"(<robot[^>]*>)", r"\g<1><!-- no more than a word -->", set()),
    ],
)
def test_a_change_voids_what_depends_on_it(
    place: Path, file: str, pattern: str, new: str, expected: set[str]
) -> None:
    assert void(load_robot(place)) == set()
    edit(place / file, pattern, new)
    assert void(load_robot(place)) == expected


@pytest.mark.parametrize("step", ENTRIES)
def test_a_stated_value_does_not_make_a_void_one_valid(place: Path, step: ArmingStep) -> None:
    """Values stated in config.yaml win over identified levels alone."""
    known = rf"\1known: {{{step}: maker}}\n\1half_gap:"
    edit(place / "config.yaml", "( *)half_gap:", known)
    edit(place / "config.yaml", r"gear: [\d.]+", "gear: 77.0")
    robot = load_robot(place)
    (joint,) = robot.configuration.joints
    assert (joint.friction.motor_coulomb, joint.body) == (0.3, BODY)
    assert void(robot) == ALL - ({step} & {"wiring", "thresholds"})


def test_a_correction_of_an_encoder_is_void_after_a_change(place: Path) -> None:
    correction = [Harmonic(order=1, cosine=0.04)]
    encoders = EncodersEntry(**DAY, link_correction=correction, left=0.3)
    for gear, step, entry in (
        (77.0, "encoders", encoders), *((78.0, *one) for one in ENTRIES.items())
    ):  # fmt: skip
        edit(place / "config.yaml", r"gear: [\d.]+", f"gear: {gear}")
        identify(place, step, entry)
    robot = load_robot(place)
    assert robot.configuration.joints[0].wiring.link_correction == correction
    (reason,) = parameters_missing(robot.identified, robot.configuration, robot.urdf)
    assert "the encoders of joint identified before drives, wiring, period" in reason
    edit(place / "config.yaml", r"gear: [\d.]+", "gear: 77.0")
    robot = load_robot(place)
    assert outdated("encoders", robot.identified, robot.configuration, robot.urdf) == []


def test_a_void_step_is_asked_for_and_valid_again_when_the_change_is_undone(place: Path) -> None:
    """Friction that was identified with the old masses holds for these."""
    before = (place / "arm.urdf").read_text()
    edit(place / "arm.urdf", r'(<mass value=")[\d.]+', r"\g<1>1.05")
    robot = load_robot(place)
    masses, friction, levels = parameters_missing(robot.identified, robot.configuration, robot.urdf)
    assert "the masses of joint identified before" in masses
    assert "the friction of joint identified before" in friction
    assert "`contactd identify thresholds` again" in levels
    identify(place, "gap", ENTRIES["gap"])
    (place / "arm.urdf").write_text(before)
    assert void(load_robot(place)) == set()


def test_an_older_file_is_valid_as_a_whole_until_it_is_written_again(place: Path) -> None:
    robot = load_robot(place)
    digest = fingerprint(robot.configuration, robot.urdf)
    assert robot.identified is not None
    old = robot.identified.joints["joint"]
    whole = Identified(configuration=digest, joints={"joint": type(old)(serial=1, **ENTRIES)})
    write_identified(place / "identified.yaml", whole)
    robot = load_robot(place)
    assert void(robot) == set()
    again = merged(robot, "gap", {"joint": ENTRIES["gap"]}, {"joint": 1})
    assert again.joints["joint"] == old
    edit(place / "arm.urdf", r'(<mass value=")[\d.]+', r"\g<1>1.05")
    changed = load_robot(place)
    assert void(changed) == ALL
    left = merged(changed, "gap", {"joint": ENTRIES["gap"]}, {"joint": 1}).joints["joint"]
    assert (left.wiring, left.friction, left.thresholds) == (None, None, None)


def commissioned(folder: Path) -> Path:
    """Romeo's arm, on which all steps but masses passed."""
    place = folder / "arm"
    shutil.copytree(ROMEO, place)
    (place / "identified.yaml").unlink()
    edit(place / "config.yaml", r"(?m)^ *known:.*\n", "", count=0)
    low, rub = Levels(contact=0.2, collision=0.4), Friction(motor_coulomb=0.01)
    for step, entry in {
        "zero": ZeroEntry(**DAY, link_sign=1, link_offset=0.0),
        "wiring": ENTRIES["wiring"],
        "gap": GapEntry(**DAY, half_gap=0.01, confidence=0.001),
        "friction": FrictionEntry(**DAY, friction=rub, errors={}, r2=1.0, condition=1.0),
        "thresholds": ThresholdsEntry(**DAY, thresholds=low, per_hour=1.0, largest=0.3),
    }.items():
        identify(place, step, entry)
    return place


WIRED, MOVED, JOINT = ("zero", "wiring", "gap"), ("friction", "thresholds"), "LShoulderYaw"


@pytest.mark.parametrize(
    ("path", "new", "voids"),
    [
        ("wiring.motor_sign", -1, {"wiring", "gap"}),
        ("wiring.gear", 77.0, {"wiring", "gap"}),
        ("wiring.max_current_A", 2.5, {"wiring", "gap"}),
        ("wiring.rated_current_A", 3.3, {"wiring", "gap"}),
        ("wiring.node", 99, {"zero", "wiring", "gap"}),
        (".torque_constant", 3.3, {"wiring"}),
    ],
)
def test_a_change_at_one_joint_voids_the_wiring_of_that_joint_alone(
    tmp_path: Path, path: str, new: float, voids: set[str]
) -> None:
    place = commissioned(tmp_path)
    robot = load_robot(place)
    drives = dict.fromkeys(robot.configuration.joint_names, 1)
    assert not objections(robot.identified, robot.configuration, robot.urdf, drives)
    text = yaml.safe_load((place / "config.yaml").read_text())
    (joint,) = (one for one in text["joints"] if one["name"] == JOINT)
    part, _, field = path.partition(".")
    (joint[part] if part else joint)[field] = new
    (place / "config.yaml").write_text(in_yaml(text))
    robot = load_robot(place)
    c, urdf = robot.configuration, robot.urdf
    assert {step: outdated(step, robot.identified, c, urdf) for step in (*WIRED, *MOVED)} == {
        **{step: [JOINT] if step in voids else [] for step in WIRED},
        **dict.fromkeys(MOVED, c.joint_names),
    }
    against = " ".join(objections(robot.identified, c, urdf, drives))
    assert f"`contactd identify wiring {JOINT}` again" in against
    again = merged(robot, "wiring", {JOINT: ENTRIES["wiring"]}, drives)
    assert outdated("wiring", again, c, urdf) == []


@pytest.mark.parametrize(
    ("file", "pattern", "new", "steps"),
    [
        ("config.yaml", r"(period_ms: )[\d.]+", r"\g<1>8", WIRED[1:]),  # a zero has no period
        ("config.yaml", r"(link_position: .*scale: )[\d.e+-]+", r"\g<1>2.4e-05", WIRED),
        ("arm.urdf", r'(<axis xyz=")[^"]+', r"\g<1>1 0 0", WIRED),
    ],
)
def test_a_change_that_all_joints_share_voids_all(
    tmp_path: Path, file: str, pattern: str, new: str, steps: tuple[str, ...]
) -> None:
    place = commissioned(tmp_path)
    edit(place / file, pattern, new)
    robot = load_robot(place)
    for step in (*steps, *MOVED):
        void = outdated(step, robot.identified, robot.configuration, robot.urdf)
        assert void == robot.configuration.joint_names


def test_older_marks_of_the_whole_arm_hold_until_a_change(tmp_path: Path) -> None:
    place = commissioned(tmp_path)
    robot = load_robot(place)
    assert robot.identified is not None
    of = digests(robot.configuration, robot.urdf)[WiringEntry.depends]
    wiring = WiringEntry(**DAY, follows=1.0, of=of)
    joints = {
        name: msgspec.structs.replace(joint, wiring=wiring)
        for name, joint in robot.identified.joints.items()
    }
    old = Identified(joints=joints)
    before = replace(robot, identified=old)
    assert outdated("wiring", old, robot.configuration, robot.urdf) == []
    gap = robot.identified.joints[JOINT].gap
    assert gap is not None
    later = merged(before, "gap", {JOINT: gap}, {})
    assert later.joints == robot.identified.joints
    edit(place / "config.yaml", r"(gear: )[\d.]+", r"\g<1>77.0")
    c = load_robot(place).configuration
    assert outdated("wiring", old, c, robot.urdf) == c.joint_names
    assert outdated("wiring", later, c, robot.urdf) == c.joint_names[:1]
