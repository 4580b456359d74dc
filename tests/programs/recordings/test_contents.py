"""Contents of a recording, by made-up States and by old files."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from daemon.protocol.state import STATE_FORMAT, Contact, Notice, Snapshot, State
from programs.clients.replay import SAME_ESTIMATOR
from programs.contactd.contactd import main
from programs.recordings.contents import Contents
from tests.fake_daemon import snapshot_at, state_at
from tests.programs.clients.test_damaged_recordings import changed, set_to
from tests.programs.clients.test_damaged_recordings import written as damaged
from tests.programs.clients.test_recorder import FORMATS

JOINT = 1  # the one that `state_at` pushes


def notice(level: Any, torque: float = -1.3) -> Notice:
    contact = Contact(joint="LShoulderYaw", torque=torque, threshold=0.5, level=level, side="left")
    return Notice(kind="contact", text="touched", contact=contact)


def found(states: list[State], snapshot: Snapshot) -> Contents:
    contents = Contents()
    contents.add_snapshot(snapshot)
    contents.add(states[:7])
    contents.add(states[7:])
    return contents


def test_a_contact_lasts_until_its_thresholded_residual_is_zero() -> None:
    contents = found([state_at(tick) for tick in range(90, 260)], snapshot_at(89))
    (contact,) = contents.contacts
    assert (contact.joint, contact.peak, contact.level) == ("LShoulderYaw", -1.3, "contact")
    assert contact.time_s == pytest.approx(0.10)
    assert contact.duration_s == pytest.approx(1.0)
    assert contents.modes == pytest.approx({"tracking": 0.7, "admittance": 1.0})
    assert (contents.states, contents.lost) == (170, 0)
    assert contents.duration_s == pytest.approx(1.69)


def test_a_collision_belongs_to_the_contact_that_lasts() -> None:
    states = [state_at(tick) for tick in range(90, 150)]
    states[20] = state_at(110, notices=[notice("collision")])
    (contact,) = found(states, snapshot_at(89)).contacts
    assert (contact.level, contact.duration_s) == ("collision", None)


def test_the_other_side_is_another_contact() -> None:
    states = [state_at(tick) for tick in range(90, 150)]
    states[20] = state_at(110, notices=[notice("contact", torque=2.0)])
    first, second = found(states, snapshot_at(89)).contacts
    assert first.duration_s == pytest.approx(0.10)
    assert second.peak == 2.0


def test_gaps_and_faults_are_counted() -> None:
    fault = Notice(kind="fault", text="drive fault: joint 2")
    states = [state_at(0), state_at(1), state_at(5, notices=[fault]), state_at(6)]
    contents = found(states, snapshot_at(-1))
    assert contents.lost == 3
    assert [(one.time_s, one.text) for one in contents.faults] == [(0.05, "drive fault: joint 2")]
    assert contents.events == contents.faults


def test_the_duration_of_a_contact_ends_where_states_are_lost() -> None:
    ticks = [*range(90, 150), *range(1_000_000, 1_000_010)]
    (contact,) = found([state_at(tick) for tick in ticks], snapshot_at(89)).contacts
    assert contact.duration_s == pytest.approx(0.49)


@pytest.mark.parametrize("version", FORMATS)
def test_replay_lists_the_contents_of_a_file_of_each_format(version: int) -> None:
    answer = CliRunner().invoke(main, ["replay", str(FORMATS[version])])
    assert f"format {version}" in answer.output
    assert "states of joint" in answer.output
    assert ("bit-identical" in answer.output) == (version >= SAME_ESTIMATOR)
    assert answer.exit_code == (0 if version >= SAME_ESTIMATOR else 65)
    assert version != 2 or "1      0.26 s  joint            +2.95 Nm at most" in answer.output


def test_replay_lists_the_contents_in_json() -> None:
    answer = CliRunner().invoke(main, ["replay", "--json", str(FORMATS[STATE_FORMAT])])
    reported = json.loads(answer.stdout)
    assert reported["identical"] is True
    assert reported["contents"]["duration_s"] == pytest.approx(0.89)
    assert reported["contents"]["joints"] == ["joint"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"PK\x03\x04 something else altogether", "is not an MCAP file"),
        (FORMATS[4].read_bytes()[:900], "ends in the middle"),
    ],
    ids=["empty", "foreign", "cut"],
)
def test_a_file_that_is_no_recording_gets_one_line(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "strange.mcap"
    path.write_bytes(content)
    answer = CliRunner().invoke(main, ["replay", str(path)])
    assert answer.exit_code == 65
    (line,) = answer.stderr.splitlines()
    assert line.startswith(f"contactd: {path} {said}")


ABSENT = {"joint": "absent", "torque": 1.0, "threshold": 0.0, "level": "contact", "side": "left"}
UNKNOWN = [{"kind": "contact", "text": "x", "contact": ABSENT}]
DAMAGES = {
    "no half-gap": ("/snapshot", set_to("half_gap", value=[])),
    "no joints": ("/snapshot", set_to("joints", value=[])),
    "ragged": ("/state", set_to("beside", value={"classical": [1.0, 2.0]})),
    "empty beside": ("/state", set_to("beside", value={"classical": []})),
    "unknown joint": ("/state", set_to("notices", value=UNKNOWN)),
    "no time of day": ("/state", set_to("timing", "wall_s", value=1e18)),
    "huge value": ("/state", set_to("residual", value=[1e308])),
    "beside a path": ("/state", set_to("beside", value={"x/../../y\0": [1.0]})),
    "unprintable": ("/snapshot", set_to("joints", value=["</script>\x1b]0;\n"])),
    "no YAML": ("/snapshot", set_to("configuration", value="a: [")),
    "no XML": ("/snapshot", set_to("urdf", value="<robot")),
    "no robot": ("/snapshot", set_to("urdf", value="<x/>")),
    "no memory": ("/snapshot", set_to("memory", value={"x": 1})),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize(
    "command",
    [
        ["replay"], ["plot", "-o", "{}/a.html"], ["whatif", "--threshold", "joint=1,2"],
        ["whatif", "--residual", "classical"], ["whatif", "--set", "estimator.gain=20"],
        ["whatif", "--propose-labels", "{}/l.csv"], ["export", "--csv", "-o", "{}/a.csv"],
        ["export", "--foxglove", "-o", "{}/f.mcap"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_damage_never_ends_in_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], damage: tuple[str, Any]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = damaged(tmp_path / "damaged.mcap", changed(*damage))
    arguments = [part.format(tmp_path) for part in command]
    answer = CliRunner().invoke(main, [*arguments, str(path)])
    assert answer.exit_code in {0, 1, 65}, answer.output
    assert "Traceback" not in answer.output
    assert answer.output.isascii()
    assert "\x1b" not in answer.output
    for line in answer.stderr.splitlines():
        assert line.startswith(f"contactd: {path}")
