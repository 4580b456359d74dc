"""Logs of other programs as recordings: the estimator's results for their samples."""

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from common.errors import LogError
from daemon.config.load import load_robot
from daemon.modes.table import Event
from daemon.protocol.state import State
from estimator.model import Model
from identification.motion_log import MotionLog
from programs.clients.replay import replay
from programs.contactd.contactd import main
from programs.identify.csv_log import read_csv
from programs.identify.foreign import recording_of
from programs.recordings.contents import Contents
from programs.recordings.over_log import over_log

PUSH_S, LASTS_S, PUSH = 6.0, 0.6, 3.0


@pytest.fixture(scope="module")
def states() -> list[State]:
    """12 s of the single joint on its sinusoid, pushed once."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        rig.request(Event.START)
        found = rig.states(PUSH_S)
        rig.arm.external_torque[0] = PUSH
        found += rig.states(LASTS_S)
        rig.arm.external_torque[0] = 0.0
        return found + rig.states(5.0)


def saved(path: Path, states: list[State], without: str = "", every: int = 1) -> Path:
    columns = {
        "time": [s.time_s for s in states],
        "current.joint": [s.current[0] for s in states],
        "link_position.joint": [s.link_position[0] for s in states],
        "motor_velocity.joint": [s.motor_velocity[0] for s in states],
        "motor_position.joint": [s.motor_position[0] if s.motor_position else 0 for s in states],
        "setpoint.joint": [s.setpoint[0] for s in states],
    }
    columns.pop(without, None)
    rows = np.stack(list(columns.values()), axis=1)[::every]
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


def contactd(command: str, path: Path, *more: object):
    return CliRunner().invoke(main, [command, str(path), *map(str, more)])


def replayed(path: Path, *more: str):
    return contactd("replay", path, "--config", SINGLE_JOINT, *more)


def test_residual_and_contact_of_a_csv_are_those_of_the_daemon(tmp_path, states):
    path = saved(tmp_path / "log.csv", states)
    result = replayed(path, "--json")
    assert result.exit_code == 0, result.output
    listed = json.loads(result.output)
    notices = [n for s in states for n in s.notices if n.kind == "contact"]
    assert len(listed["contacts"]) >= 1
    assert len(notices) >= 1
    (first, *_) = listed["contacts"]
    begun = states[0].time_s
    (felt,) = [s for s in states if any(n.kind == "contact" for n in s.notices)][:1]
    assert first["joint"] == "joint"
    assert first["time_s"] == pytest.approx(felt.time_s - begun, abs=0.03)
    assert first["peak"] == pytest.approx(PUSH, rel=0.3)
    assert 0.3 < first["duration_s"] < 1.5
    largest = max(abs(s.residual[0]) for s in states)
    assert listed["largest"] == pytest.approx([largest], rel=0.05)
    said = replayed(path).output
    assert "residual  joint" in said
    assert "Nm at most, beyond" in said


def test_a_collision_that_follows_belongs_to_its_contact(tmp_path, states):
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration
    levels = msgspec.structs.replace(c.joints[0].thresholds, contact=0.8, collision=1.6)
    lower = msgspec.structs.replace(c.joints[0], thresholds=levels)
    log, _ = read_csv(saved(tmp_path / "log.csv", states), ["joint"], {})
    at = replace(robot, configuration=msgspec.structs.replace(c, joints=[lower]))
    contents = Contents()
    for part in over_log(log, at):
        contents.take(part)
    pushes = [one for one in contents.contacts if abs(one.time_s - PUSH_S) < 0.5]
    assert [one.level for one in pushes] == ["collision"]


def test_samples_at_another_period_are_reported(tmp_path, states):
    # Those before the push, so that nothing fast is lost between two samples.
    path = saved(tmp_path / "log.csv", states[:500], every=2)
    result = replayed(path)
    assert result.exit_code == 0, result.output
    assert "samples every 20 ms: resampled to 10 ms" in result.output
    assert "contacts  none" in result.output


@pytest.fixture
def cached(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("cached")
def test_it_is_a_recording_that_repeats_bit_by_bit(tmp_path, states):
    made = recording_of(saved(tmp_path / "log.csv", states), SINGLE_JOINT)
    assert replay(made).identical
    assert recording_of(tmp_path / "log.csv", SINGLE_JOINT) == made
    later = recording_of(saved(tmp_path / "log.csv", states[100:]), SINGLE_JOINT)
    assert later != made  # the cache goes by content


@pytest.mark.usefixtures("cached")
def test_it_is_plotted_and_asked_like_a_recording(tmp_path, states):
    path = saved(tmp_path / "log.csv", states)
    page, curves = tmp_path / "a.html", tmp_path / "b.html"
    by = ["--config", SINGLE_JOINT]
    result = contactd("plot", path, *by, "--around", "contact:1", "-o", page)
    assert result.exit_code == 0, result.output
    assert "beyond its threshold" in result.output
    assert page.stat().st_size > 10_000
    labels = tmp_path / "labels.txt"  # a folder is asked for all of its .csv
    labels.write_text(f"file,start_s,end_s,joint\nlog.csv,{PUSH_S},{PUSH_S + 1.0},joint\n")
    by += ["--threshold", "joint=0.8,2,90", "--set", "estimator.gain=20"]
    result = contactd("whatif", tmp_path, *by, "--labels", labels, "-o", curves, "--json")
    assert result.exit_code == 0, result.output
    (listed,) = json.loads(result.output)["recordings"]
    assert listed["file"] == str(path)
    (curve, *_) = json.loads(result.output)["curves"]
    assert [point["found"] for point in curve["points"]] == [1, 1, 0]
    assert curves.exists()
    wrong = contactd("whatif", path, *by[:2], "--threshold", "elbow=1").output
    assert f"{path} has no joint 'elbow'" in wrong


@pytest.mark.parametrize("command", ["plot", "whatif"])
def test_pictures_and_answers_of_a_csv_need_a_configuration(tmp_path, states, command):
    path = saved(tmp_path / "log.csv", states[:200])
    assert contactd(command, path).exit_code == 2


@pytest.mark.parametrize("column", ["current.joint", "time"])
def test_a_missing_column_is_reported(tmp_path, states, column):
    result = replayed(saved(tmp_path / "log.csv", states[:200], without=column))
    assert result.exit_code == 65
    assert f"no column {column}" in result.output


def test_a_csv_needs_a_configuration_and_a_recording_has_its_own(tmp_path, states):
    path = saved(tmp_path / "log.csv", states[:200])
    result = contactd("replay", path)
    assert result.exit_code == 2
    assert "a log of another program needs --config" in result.output
    other = tmp_path / "log.mcap"
    other.write_bytes(b"")
    result = replayed(other)
    assert result.exit_code == 2
    assert "--config is for a log of another program" in result.output


def test_missing_motor_positions_are_reported():
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration
    estimator = msgspec.structs.replace(c.estimator, motor_position="measured")
    t, zero = 0.01 * np.arange(200), np.zeros((200, 1))
    log = MotionLog(("joint",), t, zero, zero, zero)
    with pytest.raises(LogError, match="lacks motor_position of some joints"):
        over_log(log, replace(robot, configuration=msgspec.structs.replace(c, estimator=estimator)))


def test_times_in_milliseconds_are_refused(tmp_path, states):
    """Between samples 10 s apart nothing was measured; a long log would become a hundred million
    samples."""
    late = [msgspec.structs.replace(s, time_s=1e3 * s.time_s) for s in states]
    result = replayed(saved(tmp_path / "log.csv", late))
    assert result.exit_code != 0
    assert "samples every 10 s, the configuration's period is 0.01 s" in result.output


def test_a_pause_begins_anew_and_is_no_contact():
    robot = load_robot(SINGLE_JOINT)
    t, zero = 0.01 * np.arange(800), np.zeros((800, 1))
    # Meanwhile it was moved, and its motor with it.
    later = (np.arange(800) >= 400)[:, None] * 0.4
    log = MotionLog(("joint",), np.where(later[:, 0] > 0.0, t + 20.0, t), zero, later, zero, later)
    _, made = over_log(log, robot)
    largest = np.abs([state.residual for state in made]).max(axis=0)
    gravity = Model(robot.urdf, ["joint"]).gravity(np.array([0.4]))[0]
    assert largest == pytest.approx([abs(gravity)], rel=0.1)  # which no current holds
