"""The gap of a live joint without a hand, in lockstep: found, touched, refused, too far."""

import re
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from rich.console import Console

from bench.rigs.generated_arms import generate
from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from daemon.config.identified import GapEntry, write_identified
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from estimator.model import Model
from programs.identify.identification import Identification
from programs.identify.live_arm import LiveArm
from programs.identify.live_strokes import StrokesOfJoint, UnobservableError
from programs.identify.merge import merged
from programs.identify.motions import WIRING_SPEED, strokes
from programs.identify.steps.gap import gap
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import TypedCommand, wired_joint


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


def test_the_gap_of_a_joint_that_no_one_touches(arm: CommissionedArm) -> None:
    with arm.served() as served:
        served.rig.enable()
        typed = TypedCommand(served, "gap")
        fastest, positions = 0.0, []
        while typed.running:
            typed.tick()
            if served.rig.mode is Mode.TRACKING:
                fastest = max(fastest, abs(float(served.rig.arm.plant.theta_dot[0])))
                positions.append(float(served.rig.arm.plant.q[0]))
        status, said = typed.ends()
        true = float(served.rig.arm.plant.parameters.half_gap[0])
    assert status == 0, said
    assert "clear" in said
    assert "joint moves to and fro by itself, at most 30 mrad/s" in said
    found = load_robot(arm.folder).identified
    assert found is not None
    entry = found.joints["joint"].gap
    assert entry is not None
    assert abs(entry.half_gap - true) < max(0.05 * true, 0.0005)
    assert abs(entry.half_gap - true) < entry.confidence
    assert fastest < 2.0 * WIRING_SPEED
    assert np.ptp(positions) < 0.4
    # What was measured is kept, its scouts are not.
    (kept,) = (arm.folder / "identify").glob("*.mcap")
    assert kept.name.startswith("strokes-joint-2")


def test_a_touch_ends_it_and_nothing_is_written(arm: CommissionedArm) -> None:
    before = (arm.folder / "identified.yaml").read_bytes()
    with arm.served() as served:
        served.rig.enable()
        typed = TypedCommand(served, "gap")
        typed.moves(1.5)
        served.rig.arm.external_torque[0] = 1.5
        typed.moves(2.5)
        served.rig.arm.external_torque[0] = 0.0
        status, said = typed.ends()
        assert served.rig.mode is Mode.HOLDING
    assert status == 1
    (torque,) = re.findall(r"joint ([+-]\S+) Nm \(contact\)", said)
    (level,) = re.findall(r"set its thresholds.contact to (\S+) until", " ".join(said.split()))
    assert float(level) == pytest.approx(2.0 * abs(float(torque)), abs=0.06)
    assert "The same command starts joint afresh" in " ".join(said.split())
    assert (arm.folder / "identified.yaml").read_bytes() == before


def test_a_joint_that_gravity_holds_wants_a_hand() -> None:
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration
    # It hangs at 0.
    limits = msgspec.structs.replace(c.joints[0].limits, lower=0.3, upper=1.2)
    held = msgspec.structs.replace(c, joints=[msgspec.structs.replace(c.joints[0], limits=limits)])
    with pytest.raises(UnobservableError, match="identify gap joint --by-hand"):
        StrokesOfJoint.of(held, Model(robot.urdf, c.joint_names), 0, np.array([0.5]))


def test_without_names_it_goes_on_with_what_has_no_gap(tmp_path: Path) -> None:
    folder = generate(3).write(tmp_path / "arm")
    names = load_robot(folder).configuration.joint_names
    found = GapEntry(date="2026-01-02T03:04:05+00:00", log="0", half_gap=0.005, confidence=0.0)
    entries = merged(load_robot(folder), "gap", dict.fromkeys(names[1:], found), {})
    write_identified(folder / "identified.yaml", entries)
    identification = Identification(load_robot(folder), Console(), dry=True)
    assert identification.due("gap", ()) == names  # of logs
    identification.arm = cast(LiveArm, "an arm")
    assert identification.due("gap", ()) == [names[0]]
    assert identification.due("gap", (names[2],)) == [names[2]]
    assert identification.due("wiring", ()) == names


def test_one_that_wants_a_hand_is_listed_and_the_others_go_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    identification = Identification(load_robot(ROMEO), Console(), dry=True)

    def held(live: object, *, gap_of: str) -> Any:
        raise UnobservableError(f"gravity holds {gap_of}")

    identification.measured = held  # type: ignore[method-assign]
    assert not gap.run(identification, ("LElbowRoll", "LElbowYaw"), by_hand=False)
    said = capsys.readouterr().out
    assert "gravity holds LElbowRoll" in said
    assert "gravity holds LElbowYaw" in said


def test_strokes_begin_and_end_here_and_go_no_further_than_asked() -> None:
    here = np.array([0.3, -0.2])
    path = strokes(here, 1, 0.1, 0.02, 4, 0.01)
    assert path[0] == pytest.approx(here)
    assert path[-1] == pytest.approx(here, abs=1e-9)
    assert np.ptp(path[:, 0]) == 0.0
    assert path[:, 1].max() - 0.3 < 0.0
    assert np.ptp(path[:, 1]) < 0.1 + 0.2 * 0.02 + 1e-9
    assert np.abs(np.diff(path[:, 1])).max() / 0.01 < 1.05 * 0.02


def test_it_is_said_what_will_move_and_how_far() -> None:
    robot = load_robot(ROMEO)
    c = robot.configuration
    here = np.array([0.5 * (j.limits.lower + j.limits.upper) for j in c.joints])
    own = StrokesOfJoint.of(c, Model(robot.urdf, c.joint_names), 0, here)
    text = own.announcement()
    assert text.startswith(f"The arm moves slowly: LShoulderPitch from {here[0]:.2f} to")
    low, high = own.room
    limits = c.joints[0].limits
    assert limits.lower < low < high < limits.upper
    assert f"within {low:.2f} and {high:.2f} rad. Hands off: a touch ends it." in text
