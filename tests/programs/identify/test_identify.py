"""`contactd identify` on logs: from measurements to identified.yaml, and from there to arming."""

import csv
import dataclasses
import itertools
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT, lockstep_rig
from common.errors import ConfigurationError, LogError
from daemon.config import evidence
from daemon.config import identified as file
from daemon.config.load import load_robot, parse_configuration
from daemon.modes.table import Event, Mode
from daemon.motion.sampled_path import PathBuilder
from daemon.protocol.replies import Check
from estimator.body_inertia import BodyInertia
from programs.contactd.contactd import main
from programs.identify.measured import from_states, moved, raised
from programs.identify.merge import merged
from programs.identify.steps.friction import friction_outcome
from programs.identify.steps.thresholds import thresholds_outcome

DAY = "2026-01-02T03:04:05+00:00"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A copy of the single joint, of which nothing is known yet."""
    shutil.copytree(ROMEO, tmp_path / "romeo_left_arm")
    ignored = shutil.ignore_patterns("identified.yaml")
    return Path(shutil.copytree(SINGLE_JOINT, tmp_path / "single_joint", ignore=ignored))


@pytest.fixture(scope="session")
def states():
    """20 s of the single joint on its sinusoid, pushed once."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        rig.request(Event.START)
        found = rig.states(14.0)
        rig.arm.external_torque[0] = 3.0
        found += rig.states(0.3)
        rig.arm.external_torque[0] = 0.0
        rig.run(1.0)
        rig.request(Event.START) if rig.mode.value == "holding" else None
        return found + rig.states(16.0)


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))
    return path


def by_hand(alpha: float = 0.09, visits: int = 24) -> dict[str, np.ndarray]:
    """A link led from border to border of its gap, the motor standing."""
    way = np.clip(np.arange(90) / 40.0, 0.0, 1.0)
    ends = np.concatenate([[0.0], np.resize([alpha, -alpha], visits)])
    q = np.concatenate([a + (b - a) * way for a, b in itertools.pairwise(ends)])
    q = q + 2e-5 * np.random.default_rng(0).standard_normal(len(q))
    zero = np.zeros_like(q)
    return {
        "time": 0.01 * np.arange(len(q)),
        "current.joint": -0.05 * np.sign(q) * (np.abs(q) > 0.99 * alpha),
        "link_position.joint": q,
        "motor_velocity.joint": zero,
        "motor_position.joint": zero,
    }


def identify(folder: Path, log: Path, *step: str):
    return CliRunner().invoke(main, ["identify", *step, "--config", str(folder), "--log", str(log)])


def test_gap_of_a_csv_ends_in_the_configuration(folder):
    log = write(folder / "hand.csv", by_hand())
    result = identify(folder, log, "gap")
    assert result.exit_code == 0, result.output
    assert "alpha 90.0" in result.output
    found = yaml.safe_load((folder / "identified.yaml").read_text())
    assert found["joints"]["joint"]["gap"]["half_gap"] == pytest.approx(0.09, abs=1e-4)
    robot = load_robot(folder)
    assert robot.configuration.joints[0].half_gap == pytest.approx(0.09, abs=1e-4)
    # A replay of what this daemon records thinks with the same gap.
    again = parse_configuration(robot.text, "recorded", robot.identified_text)
    assert again == robot.configuration


def test_a_log_of_a_hand_is_judged_as_one_on_request(folder):
    """Its motor gave way to the hand at one slow speed, as if it made strokes."""
    columns = by_hand()
    there = np.tile(np.interp(np.arange(90), [40, 60, 80], [0.0, 0.004, 0.0]), 24)
    theta = there * np.sign(columns["link_position.joint"])
    columns["motor_position.joint"] = theta
    columns["motor_velocity.joint"] = np.gradient(theta, columns["time"])
    columns["link_position.joint"] += theta
    log = write(folder / "hand.csv", columns)
    assert "0 strokes of the motor" in identify(folder, log, "gap").output
    result = identify(folder, log, "gap", "--by-hand")
    assert result.exit_code == 0, result.output
    assert "alpha 90.0" in result.output


@pytest.mark.parametrize(
    ("change", "says"),
    [(lambda c: {k: v[:50] for k, v in c.items()}, "too short"),
     (lambda c: {k: v for k, v in c.items() if k != "time"}, "no column time"),
     (lambda c: {**c, "current.joint": np.full(len(c["time"]), np.nan)}, "bad.csv:2: current"),
     (lambda c: {**c, "time": c["time"][::-1]}, ".csv:3: time is before"),
     (lambda c: {**c, "current.joint": ["x"] * len(c["time"])}, "not a number")],
)  # fmt: skip
def test_bad_logs_write_nothing(folder, change, says):
    log = write(folder / "bad.csv", change(by_hand()))
    result = identify(folder, log, "gap")
    assert result.exit_code == 65
    assert says in result.output
    assert not (folder / "identified.yaml").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [("{header}\n" + "1" * 200_000 + ",2,3,4\n", "bad.csv:2: is not CSV: field larger than"),
     ("x" * 200_000, "bad.csv:1: is not CSV: field larger than"),
     ("{header}\n" + "x" * 100_000 + ",2,3,4\n", "bad.csv:2: time is 'xxx"),
     ("{header}\n1,2,3\n", "bad.csv:2: 3 fields, the header has 4: is the file cut off?"),
     ("{header}\n1,2,3,4,5\n", "bad.csv:2: 5 fields, the header has 4: is a decimal written with"),
     ("{header},time\n1,2,3,4,5\n", "bad.csv: duplicate columns time"),
     ("{header}\n1,2,3,4\n\n2,2,3,4\n", "bad.csv:3: blank line between rows"),
     ("{header}\n1,2,3,4\n2,1_0,3,4\n", "is '1_0': not a number"),
     ("{header}\n2026-31-05T10:00,2,3,4\n", "neither a number nor a time by ISO 8601"),
     ("{header}\n1,2,3,4\n1,2\x00,3,4\n", "bad.csv:3: ")],
)  # fmt: skip
def test_what_is_no_log_is_one_clear_word(folder, text, says):
    header = "time,current.joint,link_position.joint,motor_velocity.joint"
    log = folder / "bad.csv"
    log.write_text(text.replace("{header}", header))
    result = identify(folder, log, "gap")
    assert result.exit_code == 65
    assert says in result.output
    assert len(result.output) < 1000
    assert "Traceback" not in result.output


def test_a_log_that_a_step_refuses_is_named(folder):
    log = write(folder / "late.csv", by_hand())
    result = identify(folder, log, "friction")
    assert result.exit_code == 65
    assert f"contactd: {log}: motor_velocity of joint is the same throughout" in result.output


def test_a_csv_cut_in_the_middle_is_named(folder):
    log = write(folder / "cut.csv", by_hand())
    log.write_text(log.read_text()[:-30])
    result = identify(folder, log, "gap")
    assert result.exit_code == 65
    reason, _, then = result.output.partition("is the file cut off?")
    assert ("nothing written" in reason, "nothing written" in then) == (False, True)


def test_blank_lines_at_the_end_are_no_rows(folder):
    log = write(folder / "hand.csv", by_hand())
    log.write_text(log.read_text() + "\n  \n")
    assert identify(folder, log, "gap", "--dry-run").exit_code == 0


def test_an_unclear_gap_writes_nothing(folder):
    log = write(folder / "few.csv", by_hand(visits=8))
    result = identify(folder, log, "gap")
    assert result.exit_code == 1
    assert "too few crossings" in result.output
    assert "nothing written" in result.output
    assert not (folder / "identified.yaml").exists()


def test_a_folder_that_takes_no_picture_keeps_no_result_back(folder):
    (folder / "identify").touch()
    log = write(folder / "hand.csv", by_hand())
    result = identify(folder, log, "gap", "joint")
    assert result.exit_code == 0, result.output
    assert "no plot: " in result.output
    assert load_robot(folder).configuration.joints[0].half_gap == pytest.approx(0.09, rel=0.01)


def test_a_dry_run_leaves_the_folder_as_it_was(folder):
    log = write(folder / "hand.csv", by_hand())
    before = sorted(folder.rglob("*"))
    result = identify(folder, log, "gap", "joint", "--dry-run")
    assert result.exit_code == 0, result.output
    assert "nothing written" in result.output
    assert sorted(folder.rglob("*")) == before


def test_usage(folder):
    log = write(folder / "hand.csv", by_hand())
    assert "no joint elbow" in identify(folder, log, "gap", "elbow").output
    assert identify(folder, folder / "none.csv", "gap").exit_code == 65


def test_friction_without_the_touched_stretch(states, folder):
    robot = load_robot(folder)
    outcome = friction_outcome(robot, from_states(states, ["joint"]), DAY)
    assert [line.verdict for line in outcome.lines] == ["good"], outcome.lines
    (note,) = outcome.notes
    assert "joint was touched" in note
    assert 1.0 < float(note.partition(" s discarded")[0]) < 3.0
    f = outcome.entries["joint"].friction
    # The plant's friction is 10 % off the configured 0.33 Nm.
    assert abs(f.motor_coulomb + f.link_coulomb) == pytest.approx(0.33, rel=0.16)
    assert outcome.entries["joint"].r2 > 0.9
    assert f.stiction < 0.1  # the plant's is smooth
    assert "stiction 0.0" in outcome.lines[0].figures


@pytest.mark.parametrize(
    ("weighed", "urdf_off", "says"),
    [(False, 1.0, "masses may be wrong: run `contactd identify masses`, then `friction` again"),
     (False, 0.03, ": `--seconds 600` "),
     (True, 1.0, ": `--seconds 600` leaves joint +-")],
)  # fmt: skip
def test_friction_that_is_not_known_well_says_what_to_do(
    states, folder, monkeypatch, weighed, urdf_off, says
):
    monkeypatch.setattr("identification.friction_errors._BY_URDF", urdf_off)
    robot = load_robot(folder)
    if weighed:
        joint = msgspec.structs.replace(
            robot.configuration.joints[0], body=BodyInertia.of(robot.model.parameters()[0])
        )
        c = msgspec.structs.replace(robot.configuration, joints=(joint,))
        robot = dataclasses.replace(robot, configuration=c)
    measured = from_states(states[:1400], ["joint"])
    if urdf_off < 0.1:
        assert friction_outcome(robot, measured, DAY).notes == ()
    monkeypatch.setattr("programs.identify.friction_notes.WIDE", 0.02)
    (note,) = friction_outcome(robot, measured, DAY).notes
    assert note.startswith("friction is known to +-")
    assert says in note


def test_a_short_log_is_taken_on_request_only(states, folder):
    robot = load_robot(folder)
    short = from_states(states[:1000][-900:], ["joint"])
    with pytest.raises(LogError, match="at least 10 s of motion"):
        friction_outcome(robot, short, DAY)
    assert [line.joint for line in friction_outcome(robot, short, DAY, 8.0).lines] == ["joint"]


@pytest.mark.parametrize(("tracked", "kept"), [(60, 60), (40, 100)])
def test_what_was_held_before_and_after_a_motion_is_no_part_of_it(make_state, tracked, kept):
    modes = ["holding"] * (100 - tracked) + ["tracking"] * tracked
    found = [msgspec.structs.replace(make_state(k), mode=m) for k, m in enumerate(modes)]
    assert len(moved(found)) == kept


@pytest.mark.parametrize(
    ("change", "says"),
    [(lambda s: {"current": [1000.0 * x for x in s.current]}, "unit wrong by 1000"),
     (lambda s: {"link_position": [1000.0 * x for x in s.link_position]}, "wrong by 1000"),
     (lambda s: {"link_position": [min(x, 0.1) for x in s.link_position]}, "clipped"),
     (lambda s: {"link_position": [-x for x in s.link_position]}, "do not move together")],
)  # fmt: skip
def test_what_no_arm_can_have_measured(states, folder, change, says):
    spoilt = [msgspec.structs.replace(s, **change(s)) for s in states]
    with pytest.raises(LogError, match=says):
        friction_outcome(load_robot(folder), from_states(spoilt, ["joint"]), DAY)


def test_thresholds_leave_the_touch_out(states, folder):
    robot = load_robot(folder)
    doubled = from_states(raised([*states, *later(states)], robot.configuration), ["joint"])
    asked = thresholds_outcome(robot, doubled, 1.0, DAY)
    assert [line.good for line in asked.lines] == [False]  # touched twice, by whom?
    assert asked.entries == {}
    outcome = thresholds_outcome(robot, doubled, 1.0, DAY, it_was_me=True)
    (line,) = outcome.lines
    assert line.good, line
    levels = outcome.entries["joint"].thresholds
    assert levels.contact < 1.5  # the touch was of 3 Nm
    assert levels.collision >= 2.99 * levels.contact  # both are rounded


def later(states):
    end = states[-1].time_s + 10.0 - states[0].time_s
    return [msgspec.structs.replace(s, time_s=s.time_s + end) for s in states]


def test_the_file_is_replaced_at_once_or_not_at_all(folder, monkeypatch):
    robot = load_robot(folder)
    path = folder / "identified.yaml"
    gap = file.GapEntry(date=DAY, log="0", half_gap=0.02, confidence=0.001)
    first = merged(robot, "gap", {"joint": gap}, {"joint": 7})
    file.write_identified(path, first)
    before = path.read_bytes()
    monkeypatch.setattr(file.os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "no space")))
    with pytest.raises(ConfigurationError, match="no space"):
        file.write_identified(path, file.Identified())
    assert path.read_bytes() == before
    assert [p.name for p in folder.glob(".identified*")] == []
    assert load_robot(folder).identified == first


WIRED = file.WiringEntry(date=DAY, log="0", follows=1.0)


def test_arming_needs_wiring_these_drives_and_this_configuration(folder):
    robot = load_robot(folder)
    c, urdf = robot.configuration, robot.urdf
    (never,) = evidence.objections(None, c, urdf, {"joint": 7})
    assert "never checked" in never
    passed = merged(robot, "wiring", {"joint": WIRED}, {"joint": 7})
    assert evidence.objections(passed, c, urdf, {"joint": 7}) == []
    (other_drive,) = evidence.objections(passed, c, urdf, {"joint": 8})
    assert "drive 7, this is drive 8" in other_drive
    joint = c.joints[0]
    geared = msgspec.structs.replace(
        joint, wiring=msgspec.structs.replace(joint.wiring, gear=joint.wiring.gear * 1.1)
    )
    changed = msgspec.structs.replace(c, joints=[geared])
    (other,) = evidence.objections(passed, changed, urdf, {"joint": 7})
    assert "another configuration" in other
    # Limits and gains change nothing of what was measured.
    gentler = msgspec.structs.replace(
        c, joints=[msgspec.structs.replace(joint, admittance_gain=0.1)]
    )
    assert evidence.objections(passed, gentler, urdf, {"joint": 7}) == []


@pytest.mark.parametrize("folder", [ROMEO, SINGLE_JOINT, DESK_ARM])
def test_the_simulated_arms_come_wired(folder):
    """After a change of drives, wiring, torque constants or URDF in `configs/`: simulate it, run
    `contactd identify wiring`, and commit the identified.yaml that this writes."""
    robot = load_robot(folder)
    serials = {name: i for i, name in enumerate(robot.configuration.joint_names, start=1)}
    assert evidence.objections(robot.identified, robot.configuration, robot.urdf, serials) == []
    assert robot.by_hand.configuration == robot.configuration  # and nothing else was identified


def test_a_new_drive_forgets_what_was_known_of_the_old(folder):
    robot = load_robot(folder)
    gap = file.GapEntry(date=DAY, log="0", half_gap=0.02, confidence=0.001)
    old = merged(robot, "gap", {"joint": gap}, {"joint": 7})
    known = msgspec.structs.replace(old)
    file.write_identified(folder / "identified.yaml", known)
    robot = load_robot(folder)
    same = merged(robot, "wiring", {"joint": WIRED}, {"joint": 7}).joints["joint"]
    other = merged(robot, "wiring", {"joint": WIRED}, {"joint": 8}).joints["joint"]
    assert same.gap is not None
    assert (same.gap.half_gap, same.serial) == (0.02, 7)
    assert (other.gap, other.serial) == (None, 8)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("version: 2\n", "version"),
        ("joints: {elbow: {}}\n", "no joint elbow"),
        (
            "version: 1\njoints: {joint: {gap: {date: d, log: l, half_gap: -1, confidence: 0}}}\n",
            "at least 0",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_refused(folder, text, says):
    (folder / "identified.yaml").write_text(text)
    with pytest.raises(ConfigurationError, match=says):
        load_robot(folder)


def test_an_objection_keeps_the_arm_unarmed():
    never = "the wiring of joint was never checked"
    for passed, reasons in ((False, [never]), (True, [])):
        check = Check(name="identification", passed=passed, text=never)
        with lockstep_rig(SINGLE_JOINT, identification=lambda *_, check=check: check) as rig:
            rig.enable()
            rig.run(1.0)
            assert rig.permit("a test") == reasons


def test_motors_alone_stand_while_a_hand_moves_the_link():
    """With the loop over the link the motor would follow the hand through the gap."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        controller = rig.tick.controller

        def run(*, motors_only: bool) -> float:
            builder = PathBuilder(
                "stand", ["joint"], ["joint"], controller.motion.limits, 1.0,
                from_here=True, motors_only=motors_only,
            )  # fmt: skip
            builder.append([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]])
            assert controller.request(Event.START, "a test", rig.time_s, builder.finish()) == []
            before = float(rig.arm.plant.theta[0])
            moved = []
            for sign in (1.0, -1.0, 1.0):
                rig.arm.external_torque[0] = 0.15 * sign
                rig.run(1.0, lambda: moved.append(abs(float(rig.arm.plant.theta[0]) - before)))
            rig.arm.external_torque[0] = 0.0
            controller.request(Event.PAUSE, "a test", rig.time_s)
            rig.run(1.0)
            assert rig.mode is Mode.HOLDING
            return max(moved)

        assert run(motors_only=True) < 0.01
        assert run(motors_only=False) > 0.03
