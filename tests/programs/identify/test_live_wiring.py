"""Wiring checked at the running arm: how a wrong sign is reported."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import yaml

from bench.rigs.generated_arms import generate, in_yaml
from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.served_daemon import served_daemon
from common.errors import ContactdError, ControlError
from programs.identify.live_arm import LiveArm
from programs.identify.live_wiring import why_apart
from programs.simulate.simulated_robot import true_arm
from tests.programs.identify.commissioned_arm import CommissionedArm

WRONG_GEAR = (
    r"shoulder: its gear or a scale is wrong, or its gap is larger than half_gap says "
    r"\(the link moved -?0\.\d+ times as far as the motor reports\)"
)
COUNTS = (
    r"link_position\.scale, 5\.992e-06 \(1048576 counts per turn\), 9\.587e-05 \(65536 counts\)"
)


@pytest.mark.parametrize(
    ("field", "times", "says"),
    [
        ("motor_sign", -1, "shoulder: the link moves opposite to the motor: link_sign or m"),
        ("gear", 0.1, WRONG_GEAR),
        ("scale", 0.0625, COUNTS),
    ],
)
def test_a_mistake_is_named_where_link_and_motor_come_too_far_apart(
    tmp_path: Path, field: str, times: float, says: str
) -> None:
    folder = generate(3).write(tmp_path / "arm")
    path = folder / "config.yaml"
    written = yaml.safe_load(path.read_text())
    link = written["drives"]["servo"]["link_position"]
    (link if field == "scale" else written["joints"][1]["wiring"])[field] *= times
    path.write_text(in_yaml(written))
    with served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served:
        served.rig.enable()
        result = served.contactd("identify", "wiring", "shoulder", "--yes")
    said = " ".join(result.output.split())
    assert result.exit_code == 1
    assert re.search("(motor and link apart|encoder frozen): shoulder", said)
    assert re.search(says, said)
    assert "nothing written" in said


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (
            "hand moves a little did not finish: motor and link apart: elbow (by 0.06 rad)",
            ["elbow"],
        ),
        ("motor and link apart: hand (by 1 rad), elbow (by 2 rad). `x` goes on", ["elbow", "hand"]),
        ("encoder frozen: hand2. It goes on, hands off", ["hand2"]),
        ("hand moves a little did not finish: drive silent: elbow", []),
    ],
)
def test_the_joint_that_moved_is_not_blamed_for_one_that_came_apart(
    text: str, named: list[str]
) -> None:
    def read(step: str) -> None:
        raise ContactdError(f"nothing of {step}")

    joints = SimpleNamespace(joint_names=("elbow", "hand", "hand2"))
    arm = cast(LiveArm, SimpleNamespace(configuration=joints, read=read))
    assert list(why_apart(arm, ControlError(text))) == named


def test_a_gap_that_is_guessed_too_small_is_no_wrong_sign(tmp_path: Path) -> None:
    arm = CommissionedArm(tmp_path, SINGLE_JOINT)
    assert not arm.identify("wiring")
    said = " ".join(arm.output.split())
    assert "motor and link apart: joint" in said
    assert "joint: its gear or a scale is wrong, or its gap is larger than half_gap says" in said


def test_torques_are_rounded_for_people(tmp_path: Path) -> None:
    """A joint without gravity holds 0 Nm, not 3e-19."""
    arm = CommissionedArm(tmp_path, SINGLE_JOINT, change=lambda _: None)
    arm.identify("wiring")
    assert re.search(r"holds -?0(\.00\d)? Nm of -?0(\.00\d)? Nm gravity", arm.output)


def test_a_link_that_moves_by_another_share_is_moved_once_more(tmp_path: Path) -> None:
    def off(written: dict[str, Any]) -> None:
        (drive,) = written["drives"].values()
        drive["link_position"]["scale"] *= 0.85

    arm = CommissionedArm(tmp_path, SINGLE_JOINT, change=off)
    assert not arm.identify("wiring")
    said = " ".join(arm.output.split())
    assert said.count("by a different amount than its motor: once more") == 1
    assert re.search(r"the link moves 0\.8\d+ times as far as the motor reports: gear, or", said)


def said_of_a_free_link(folder: Path, seed: int, gear: float) -> str:
    """Answer about a joint about the vertical, whose link nothing holds but its gear, and whose
    configured gear is so many times the true one."""
    arm = generate(seed).write(folder / "arm")
    for name, change in (("simulation.yaml", _without_friction), ("config.yaml", _geared(gear))):
        written = yaml.safe_load((arm / name).read_text())
        change(written["joints"][0])
        (arm / name).write_text(in_yaml(written))
    with served_daemon(folder, arm, described=lambda robot, _: true_arm(robot)[0]) as served:
        served.rig.enable()
        return " ".join(served.contactd("identify", "wiring", "base", "--yes").output.split())


def _without_friction(joint: dict[str, Any]) -> None:
    joint["friction"] |= {"link_coulomb": 0.0, "link_viscous": 0.0}


def _geared(gear: float) -> Callable[[dict[str, Any]], None]:
    def change(joint: dict[str, Any]) -> None:
        joint["wiring"]["gear"] *= gear

    return change


def test_a_link_that_floats_in_its_gap_is_not_called_wrong(tmp_path: Path) -> None:
    said = said_of_a_free_link(tmp_path, seed=1, gear=1.0)
    assert re.search(r"base good link/motor (1\.00|0\.99)\d", said), said


@pytest.mark.parametrize(
    ("seed", "gear", "factor"), [(1, 1.1, r"1\.(09|10)\d"), (2, 0.9, r"0\.(89|90)\d")]
)
def test_a_wrong_gear_is_found_at_a_link_that_floats(
    tmp_path: Path, seed: int, gear: float, factor: str
) -> None:
    said = said_of_a_free_link(tmp_path, seed, gear)
    reported = rf"the link moves {factor} times as far as the motor reports: gear, or"
    assert re.search(reported, said), said


@pytest.mark.parametrize(
    ("velocity", "reported"),
    [(1.0, "undetermined wrist: the motor turned only"), (0.1, "drive does not follow: wrist")],
)
def test_a_light_wrist_held_by_friction_is_no_deaf_drive(
    tmp_path: Path, velocity: float, reported: str
) -> None:
    """Stiction of several times gravity, and a velocity loop that is slow against it."""
    folder = generate(4).write(tmp_path / "arm")
    path, truth = folder / "config.yaml", folder / "simulation.yaml"
    written, true = yaml.safe_load(path.read_text()), yaml.safe_load(truth.read_text())
    written["joints"][-1]["limits"]["velocity"] = velocity
    written["trajectory"] = {}
    true["joints"][-1]["friction"]["motor_coulomb"] = 0.7
    true["settings"] |= {"friction": "dahl", "stribeck": 1.6}
    path.write_text(in_yaml(written))
    truth.write_text(in_yaml(true))
    with served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served:
        served.rig.enable()
        result = served.contactd("identify", "wiring", "wrist", "--yes")
    said = " ".join(result.output.split())
    assert result.exit_code == 1
    assert reported in said
    assert "it obeys" in said or "its drive obeys, and friction holds it" in said
    assert "does the drive get its setpoints" not in said
