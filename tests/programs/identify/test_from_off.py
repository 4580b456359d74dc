"""`contactd identify` at an arm that is off: it is enabled for the step, off after it, and what was
found is taken up; in lockstep."""

import io
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.rigs.generated_arms import generate, in_yaml
from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from common.errors import ControlError
from daemon.config.evidence import objections
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from programs.identify.identification import may_move, may_reset
from programs.identify.session import Session
from programs.identify.steps.wiring import TO_GO_ON
from programs.simulate.simulated_robot import true_arm
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import TypedCommand, stopped, wired_joint


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


@pytest.fixture
def served(arm: CommissionedArm) -> Iterator[ServedDaemon]:
    """Off."""
    with arm.served() as served:
        yield served


def test_a_step_enables_the_drives_and_leaves_them_off_with_what_it_found_taken_up(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    (arm.folder / "identified.yaml").unlink()
    assert served.contactctl("reload").exit_code == 0
    assert not served.service.process.robot.identified
    result = served.contactd("identify", "wiring", "--yes")
    assert result.exit_code == 0, result.output
    assert result.output.endswith("the drives are off, and it is taken up\n")
    assert served.rig.mode is Mode.OFF
    assert served.service.process.files.changed() == []
    assert served.service.process.robot.identified == load_robot(arm.folder).identified
    served.rig.enable()
    assert not served.rig.tick.controller.motion.blind, "the links are trusted now"


def rewired(arm: CommissionedArm) -> None:
    path = arm.folder / "config.yaml"
    written = yaml.safe_load(path.read_text())
    written["joints"][0]["wiring"]["link_offset"] = 0.01
    path.write_text(yaml.safe_dump(written))


def test_a_step_resets_a_fault_and_takes_up_what_was_written_before_it(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    """As after a drive that did not follow, once what was advised is in the configuration."""
    served.rig.tick.controller.machine.mode = Mode.FAULTED
    rewired(arm)
    result = served.contactd("identify", "wiring", "--yes")
    assert result.exit_code == 0, result.output
    assert "the fault is reset: " in result.output
    assert "changed since" not in result.output
    assert served.rig.mode is Mode.OFF
    assert served.service.process.files.changed() == []


def test_a_fault_stays_where_no_one_can_be_asked(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    served.rig.tick.controller.machine.mode = Mode.FAULTED
    result = served.contactd("identify", "wiring")
    assert result.exit_code == 1
    assert "a fault is latched" in result.output
    rewired(arm)
    result = served.contactd("identify", "wiring")
    assert result.exit_code == 78
    said = " ".join(result.output.split())
    assert "were changed since the daemon read it: `contactctl disable` (after a fault " in said
    assert served.rig.mode is Mode.FAULTED


def test_no_question_without_a_terminal(served: ServedDaemon) -> None:
    result = served.contactd("identify", "wiring")
    assert result.exit_code == 1
    assert "the drives are off and must be enabled for this step: without a" in result.output
    assert served.rig.mode is Mode.OFF


class Terminal(io.StringIO):
    """A person who types."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("typed", "may"), [("y\n", True), ("n\n", False), ("\n", False)])
def test_a_person_is_asked(
    typed: str, may: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal(typed))
    assert may_move(load_robot(ROMEO), off=True) is may
    said = " ".join(capsys.readouterr().out.split())
    assert "its joints end as configured (hold: LShoulderPitch" in said
    assert "the emergency stop within yours" in said


@pytest.mark.parametrize(("typed", "may"), [("y\n", True), ("n\n", False), ("\n", False)])
def test_a_person_is_asked_before_a_reset(
    typed: str, may: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal(typed))
    assert may_reset("drive does not follow: elbow") is may
    assert "The arm is faulted: drive does not follow: elbow." in capsys.readouterr().out


def test_a_person_is_asked_before_an_enabled_arm_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    for typed, may in (("y\n", True), ("\n", False)):
        monkeypatch.setattr("sys.stdin", Terminal(typed))
        assert may_move(load_robot(ROMEO), off=False) is may


def test_drives_that_were_enabled_move_after_a_yes_and_stay_on(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    served.rig.enable()
    stands = float(served.rig.samples.link_position[0])
    refused = served.contactd("identify", "wiring")
    assert refused.exit_code == 1
    assert "the drives are on and the arm will move for this step: without a" in refused.output
    assert float(served.rig.samples.link_position[0]) == pytest.approx(stands, abs=1e-3)
    result = served.contactd("identify", "wiring", "--yes")
    assert result.exit_code == 0, result.output
    assert served.rig.mode is Mode.HOLDING
    assert "taken up before the drives are next enabled" in result.output
    assert served.service.process.files.changed() == ["identified.yaml"]


def test_the_arm_goes_back_to_where_it_stood(
    served: ServedDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The excitation happens to end not far from there.
    monkeypatch.setattr("programs.identify.live_arm.MOVED", 1e-4)
    stood = float(served.rig.samples.link_position[0])
    result = served.contactd("identify", "friction", "--seconds", "20", "--yes")
    assert "all joints return to where they stood" in result.output
    assert served.rig.mode is Mode.OFF
    assert float(served.rig.samples.link_position[0]) == pytest.approx(stood, abs=0.03)


@pytest.mark.parametrize(
    "words", [("gap",), ("masses",), ("friction",), ("payload", "cup"), ("thresholds",)]
)
def test_links_that_are_not_trusted_leave_the_drives_off(
    arm: CommissionedArm, served: ServedDaemon, words: tuple[str, ...]
) -> None:
    (arm.folder / "identified.yaml").unlink()
    assert served.contactctl("reload").exit_code == 0
    result = served.contactd("identify", *words, "--yes")
    assert result.exit_code == 1
    said = "the drives stay off: the wiring of joint was never checked (`contactd identify wiring`)"
    assert said in " ".join(result.output.split())
    assert served.rig.mode is Mode.OFF


def test_a_hand_may_move_a_link_that_is_not_trusted(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    (arm.folder / "identified.yaml").unlink()
    assert served.contactctl("reload").exit_code == 0
    status, said = stopped(served, "gap", "--by-hand", after_s=1.0)
    assert status == 1
    assert "gap of joint did not finish: stopped by you; the arm is holding" in said


def test_a_wiring_check_that_a_person_disables_claims_nothing_that_passed(
    served: ServedDaemon,
) -> None:
    typed = TypedCommand(served, "wiring", "--yes")
    typed.moves(1.0)
    served.contactctl("disable", "--no-wait")
    code, output = typed.ends()
    said = " ".join(output.split())
    assert code == 1
    assert TO_GO_ON in said
    assert "is kept" not in said


def test_what_a_person_disables_meanwhile_stays_off(served: ServedDaemon) -> None:
    typed = TypedCommand(served, "friction", "--seconds", "20", "--yes")
    typed.moves(1.0)
    served.contactctl("disable", "--no-wait")
    assert typed.ends()[0] == 1
    assert served.rig.mode is Mode.OFF


def test_a_step_enables_only_once(served: ServedDaemon, tmp_path: Path) -> None:
    """Between two motions of it a person may have disabled the arm, and reached in."""
    session = Session(served.path, tmp_path, print, may_move=lambda off: off)
    with closing(session):
        served.until(session.hold)
        assert served.rig.mode is Mode.HOLDING
        assert served.contactctl("disable").exit_code == 0
        with pytest.raises(ControlError, match="the drives were switched off: disable by"):
            served.until(session.hold)
    assert served.rig.mode is Mode.OFF


def test_ctrl_c_leaves_it_holding_and_says_so(served: ServedDaemon) -> None:
    status, said = stopped(served, "friction", "--seconds", "20", "--yes")
    assert status == 1
    assert "the drives stay on and the arm holds; `contactctl disable` ends this" in said
    assert served.rig.mode is Mode.HOLDING


def turned(folder: Path, names: list[str]) -> None:
    """Turn the motors' signs of these joints in config.yaml."""

    def turn(written: dict[str, Any]) -> None:
        for joint in written["joints"]:
            if joint["name"] in names:
                joint["wiring"]["motor_sign"] *= -1

    path = folder / "config.yaml"
    written = yaml.safe_load(path.read_text())
    turn(written)
    path.write_text(in_yaml(written))


def test_every_wrong_sign_is_found_at_once_and_taken_up_when_corrected(tmp_path: Path) -> None:
    folder = generate(3).write(tmp_path / "arm")
    joints = [joint.name for joint in load_robot(folder).configuration.joints]
    wrong = [joints[1], joints[-1]]
    turned(folder, wrong)
    with served_daemon(tmp_path, folder, described=lambda robot, _: true_arm(robot)[0]) as served:
        result = served.contactd("identify", "wiring", "--yes")
        said = " ".join(result.output.split())
        assert result.exit_code == 1
        for name in joints:
            assert (f"{name}: the link moves opposite" in said) == (name in wrong), said
        good = [name for name in joints if name not in wrong]
        assert f"identified.yaml: {', '.join(good)}" in said
        assert served.rig.mode is Mode.OFF
        turned(folder, wrong)
        result = served.contactd("identify", "wiring", "--yes")
        said = " ".join(result.output.split())
        assert f"identified.yaml: {', '.join(wrong)} the drives" in said
        assert "have to once more" not in said
        assert served.rig.mode is Mode.OFF
        robot = load_robot(folder)
        serials = {name: one.serial for name, one in robot.identified.joints.items()}
        assert objections(robot.identified, robot.configuration, robot.urdf, serials) == []
