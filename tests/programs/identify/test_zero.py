"""Signs and zeros of link encoders: from positions seen, and at a simulated arm."""

import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, cast

import msgspec
import numpy as np
import pytest

from bench.rigs.generated_arms import generate
from bench.rigs.lockstep import OPENARM, SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.config.drive_checks import profiles
from daemon.config.evidence import outdated
from daemon.config.identified import Identified, WiringEntry, ZeroEntry, applied, identified_keys
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.state import State
from identification.resting_link import stands
from programs.identify import session
from programs.identify.merge import merged
from programs.identify.steps.zero import not_possible, zero_outcome
from programs.identify.stream_readers import collecting
from programs.simulate.simulated_robot import true_arm
from simulator.hand_script import Lean

WIRED = WiringEntry(date="today", log="00", follows=1.0)
REST = [0.0] * 20  # [rad] from where the link stood


def robot_with(sign: int, offset: float) -> Robot:
    robot = load_robot(SINGLE_JOINT)
    (joint,) = robot.configuration.joints
    wiring = msgspec.structs.replace(joint.wiring, link_sign=sign, link_offset=offset)
    joints = [msgspec.structs.replace(joint, wiring=wiring)]
    return replace(robot, configuration=msgspec.structs.replace(robot.configuration, joints=joints))


def found(robot: Robot, seen: list[float], stood: float, *, upward: bool) -> ZeroEntry | None:
    outcome = zero_outcome(robot, "joint", np.array(seen), stood, upward=upward, date="today")
    entry = outcome.entries.get("joint")
    assert outcome.lines[0].good is (entry is not None)
    assert entry is None or isinstance(entry, ZeroEntry)
    return entry


@pytest.mark.parametrize("true_sign", [1, -1])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("upward", [True, False])
@pytest.mark.parametrize("raw", [0.4, -2.0, 9.0])  # some encoders count turns
def test_sign_and_zero_are_those_with_which_the_link_stands_where_it_was_said(
    true_sign: int, sign: int, upward: bool, raw: float
) -> None:
    stood, offset = 0.7, -0.3
    pushed = true_sign * (0.004 if upward else -0.004)
    seen = [sign * (raw + away) + offset for away in [*REST, *[pushed] * 40]]
    entry = found(robot_with(sign, offset), seen, stood, upward=upward)
    assert entry is not None
    assert entry.link_sign == true_sign
    assert entry.link_sign * raw + entry.link_offset == pytest.approx(stood, abs=1e-5)


@pytest.mark.parametrize(
    "pushed",
    [
        [0.0009] * 40,  # less than is clear
        [0.02] * 40 + [0.0] * 20,  # let go before the answer
        [0.02] * 40 + [0.02, -0.02] * 10,  # shaken
        [],
        [0.02] * 5,
    ],
)
def test_a_link_that_is_not_held_to_one_side_says_nothing(pushed: list[float]) -> None:
    assert found(robot_with(1, 0.0), [*REST, *pushed], 0.0, upward=True) is None


@pytest.mark.parametrize(
    ("pushed", "says"),
    [([0.0], "it did not move: push its link in one direction"),
     ([0.02] * 5, "it moved between +0.0 and +20.0 mrad")],
)  # fmt: skip
def test_what_is_to_be_done_is_said(pushed: list[float], says: str) -> None:
    seen = np.array([*REST, *pushed])
    outcome = zero_outcome(robot_with(1, 0.0), "joint", seen, 0.0, upward=True, date="today")
    assert outcome.lines[0].reason.startswith(says)


def test_only_a_link_at_rest_stands() -> None:
    assert stands(np.full(20, 0.3), 20)
    assert not stands(np.full(19, 0.3), 20)
    assert not stands(np.linspace(0.3, 0.302, 20), 20)


def test_a_zero_voids_what_was_found_before_it_and_not_itself() -> None:
    robot = robot_with(1, 0.0)
    entry = found(robot, [*REST, *[0.01] * 40], 0.5, upward=True)
    assert entry is not None
    wired = merged(robot, "wiring", {"joint": WIRED}, {})
    zeroed = merged(replace(robot, identified=wired), "zero", {"joint": entry}, {})
    c = applied(robot.configuration, zeroed)
    assert c.joints[0].wiring.link_offset == 0.5
    assert outdated("wiring", zeroed, c, robot.urdf) == ["joint"]
    assert outdated("zero", zeroed, c, robot.urdf) == []
    assert outdated("zero", zeroed, at_another_node(c), robot.urdf) == ["joint"]
    assert place(c, zeroed) == ["joints", "joint", "zero", "link_offset"]
    assert place(c, wired) == []


@pytest.mark.parametrize(("folder", "motor"), [(OPENARM, -1), (SINGLE_JOINT, 1)])
def test_a_motor_that_holds_both_encoders_has_the_sign_of_its_link(
    folder: Path, motor: int
) -> None:
    robot = load_robot(folder)
    one, *others = robot.configuration.joints
    seen = np.array([*REST, *[-0.01] * 40])
    outcome = zero_outcome(robot, one.name, seen, 0.0, upward=True, date="today")
    c = applied(robot.configuration, merged(robot, "zero", outcome.entries, {}))
    assert (c.joints[0].wiring.link_sign, c.joints[0].wiring.motor_sign) == (-1, motor)
    assert [joint.wiring for joint in c.joints[1:]] == [joint.wiring for joint in others]
    assert list(profiles(c, robot.folder)) == []
    assert outdated("zero", merged(robot, "zero", outcome.entries, {}), c, robot.urdf) == []


def at_another_node(c: Configuration) -> Configuration:
    wiring = msgspec.structs.replace(c.joints[0].wiring, node=99)
    return msgspec.structs.replace(c, joints=[msgspec.structs.replace(c.joints[0], wiring=wiring)])


def place(c: Configuration, identified: Identified) -> list[str | int]:
    return identified_keys(["joints", 0, "wiring", "link_offset"], c, identified)


@pytest.mark.parametrize(
    ("degrees", "meant"), [(25.0, "; in degrees? then elbow=0.4363"), (120.0, "")]
)
def test_an_angle_at_which_no_link_stands_is_refused(
    tmp_path: Path, degrees: float, meant: str
) -> None:
    robot = load_robot(generate(1).write(tmp_path / "arm"))
    i = robot.configuration.joint_names.index("elbow")
    lower, upper = generate(1).stops[i]
    assert not_possible(robot, {"elbow": lower - 0.1, "base": 0.0}) == []
    said = f"elbow={degrees:g}: outside the URDF's limits [{lower:g}, {upper:g}] rad{meant}"
    assert not_possible(robot, {"base": 0.1, "elbow": degrees}) == [said]


def test_links_are_pushed_while_the_drives_are_off(tmp_path: Path) -> None:
    folder = generate(1).write(tmp_path / "arm")
    with served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served:
        typo = served.contactd("identify", "zero", "elbo=0.1")
        degrees = served.contactd("identify", "zero", "base=0.1", "elbow=25")
        unmoved = served.contactd("identify", "zero", "elbow=0.1", answers=io.BytesIO(b"+\n"))
        served.rig.enable()
        holding = served.contactd("identify", "zero", "elbow=0.1")
    assert "no joint elbo; there are: base, shoulder" in typo.output
    assert degrees.exit_code == 78
    assert "in degrees? then elbow=0.4363" in " ".join(degrees.output.split())
    assert unmoved.exit_code == 1
    assert "and hold it there until you have answered" in " ".join(unmoved.output.split())
    assert "the arm is holding: links may only be pushed while the drives are off" in holding.output
    assert not (folder / "identified.yaml").exists()


class Wrench(io.RawIOBase):
    """An answer of a person who pushed a link so hard that its gear gave way."""

    def __init__(self, served: ServedDaemon) -> None:
        self._served = served

    def readable(self) -> bool:
        return True

    def readinto(self, into: Any) -> int:
        rig = self._served.rig
        rig.arm.hand.take(Lean(at_s=0.0, joint="elbow", torque=150.0))
        until = rig.time_s + 2.0
        while rig.mode is Mode.OFF and rig.time_s < until:
            time.sleep(0.001)
        into[:2] = b"+\n"
        return 2


@contextmanager
def belated(*reader: Any) -> Iterator[list[State]]:
    """States of a reader that is behind: the last do not come in time."""
    with collecting(*reader) as seen:
        yield list(seen)


@pytest.mark.parametrize("reader", [collecting, belated])
def test_a_fault_that_ends_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: Any
) -> None:
    monkeypatch.setattr(session, "collecting", reader)
    folder = generate(1).write(tmp_path / "arm")
    with served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served:
        served.run(0.3)
        stood = f"elbow={served.rig.arm.plant.q[2]:.2f}"
        with io.BufferedReader(Wrench(served)) as answers:
            result = served.contactd("identify", "zero", stood, answers=cast(IO[bytes], answers))
    said = " ".join(result.output.split())
    assert result.exit_code == 1
    assert "did not stay off: faulted, motor and link apart: elbow" in said, said
    assert "`contactctl reset`" in said
