"""`contactd export --lerobot`: frames as lines of JSON; with LeRobot's environment, the dataset."""

import io
import json
import os
import shutil
import subprocess
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result

from bench.rigs.lockstep import DESK_ARM
from bench.rigs.processes import pair
from programs.clients.client import Client
from programs.clients.waiting import asked_until
from programs.contactd import contactd
from programs.recordings import lerobot
from programs.recordings.lerobot import Frames, cameras_of, frame
from tests.fake_daemon import snapshot_at, state_at

RECORDING = Path(__file__).parents[1] / "clients/format_7.mcap"
ENVIRONMENT = Path(os.environ.get("CONTACTD_LEROBOT", "build/lerobot")).resolve()
NOT_BUILT = not (ENVIRONMENT / "bin" / lerobot.WRITER).exists()
needs_lerobot = pytest.mark.skipif(NOT_BUILT, reason="NOT TRIED: no LeRobot here (make lerobot)")


def export(*words: object) -> Result:
    return CliRunner().invoke(contactd.main, ["export", *map(str, words)])


def test_frames_are_at_a_steady_rate_and_carry_torque_and_mode() -> None:
    out = io.BytesIO()
    frames = Frames(out, 50, "a task", {"wrist": ["a.wrist.mp4"]})
    frames.begin(Path("a.mcap"), 3)
    frames.take(snapshot_at(0))
    states = [state_at(tick) for tick in range(100)]
    frames.take(states)
    head, *rows = map(json.loads, out.getvalue().splitlines())
    known = {"joints": snapshot_at(0).joints, "fps": 50, "task": "a task"}
    assert head == {**known, "cameras": {"wrist": ["a.wrist.mp4"]}}
    period_s = states[1].time_s - states[0].time_s
    assert len(rows) == pytest.approx(100 * period_s * 50, abs=1)
    first = states[0]
    n = len(first.residual)
    assert rows[0] == frame(first, 3, 0.0)
    assert rows[0]["observation"][2 * n : 3 * n] == first.residual
    assert rows[0]["observation"][-1] == lerobot.MODES.index(str(first.mode))
    assert rows[0]["action"] == first.reference


def test_recordings_of_two_arms_are_refused() -> None:
    frames = Frames(io.BytesIO(), 50, "a task", {})
    frames.take(snapshot_at(0))
    with pytest.raises(lerobot.LogError, match="a dataset must be of one arm"):
        frames.take(msgspec.structs.replace(snapshot_at(0), joints=["x"]))


def test_videos_beside_recordings_are_their_cameras(tmp_path: Path) -> None:
    files = [tmp_path / "a [1].mcap", tmp_path / "b.mcap"]
    for name in ("a [1].wrist.mp4", "b.wrist.mp4", "c.wrist.mp4"):
        (tmp_path / name).touch()
    expected = [str(tmp_path / "a [1].wrist.mp4"), str(tmp_path / "b.wrist.mp4")]
    assert cameras_of(files) == {"wrist": expected}
    (tmp_path / "b.top.mp4").touch()
    with pytest.raises(lerobot.LogError, match=r"a \[1\]\.top\.mp4 is missing"):
        cameras_of(files)
    assert cameras_of([tmp_path / "d.mcap"]) == {}


def test_a_missing_lerobot_is_reported_with_the_command_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CONTACTD_LEROBOT", str(tmp_path))
    result = export("--lerobot", tmp_path / "out", RECORDING)
    assert result.exit_code == 65
    assert "build it by `make lerobot`" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--csv", "--lerobot", "x"],
        ["--lerobot", "x", "--output", "y"],
        ["--csv", RECORDING],
    ],
)
def test_contradictory_forms_are_refused(words: list[object]) -> None:
    assert export(*words, RECORDING).exit_code == 2


def test_a_writer_that_fails_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / lerobot.WRITER
    program.write_text("#!/bin/sh\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setenv("CONTACTD_LEROBOT", str(tmp_path))
    result = export("--lerobot", tmp_path / "out", RECORDING)
    assert result.exit_code == 65
    assert "no dataset" in result.stderr


VIDEO = """
import sys, cv2, numpy as np
video = cv2.VideoWriter(sys.argv[1], cv2.VideoWriter_fourcc(*"mp4v"), 30, (96, 64))
for k in range(30):
    video.write(np.full((64, 96, 3), 8 * k, dtype=np.uint8))
video.release()
"""


def by_lerobot(program: str, *words: object) -> str:
    """Output of a program in LeRobot's environment."""
    command = [ENVIRONMENT / "bin/python", "-c", program, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@needs_lerobot
def test_lerobot_opens_the_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CONTACTD_LEROBOT", str(ENVIRONMENT))
    files = [tmp_path / "first.mcap", tmp_path / "second.mcap"]
    for file in files:
        shutil.copy(RECORDING, file)
        by_lerobot(VIDEO, file.with_suffix(".wrist.mp4"))
    out = tmp_path / "dataset"
    result = export("--lerobot", out, *files)
    assert result.exit_code == 0, result.stderr
    program = (
        "import sys; from lerobot.datasets.lerobot_dataset import LeRobotDataset as D;"
        "d = D('local/dataset', root=sys.argv[1], video_backend='pyav'); x = d[0];"
        "print(d.meta.total_episodes, len(d), *d.features['observation.state']['names'],"
        "*x['observation.images.wrist'].shape)"
    )
    shown = by_lerobot(program, out).split()
    assert shown[0] == "2"
    assert int(shown[1]) > 2
    assert shown[-5:] == ["contact", "mode", "3", "64", "96"]


@needs_lerobot
def test_lerobot_finds_the_plug_in() -> None:
    program = (
        "from lerobot.utils.import_utils import register_third_party_plugins as r; r();"
        "from lerobot.robots import RobotConfig as R; from lerobot.teleoperators import "
        "TeleoperatorConfig as T;"
        "print(R.get_choice_class('contactd'), T.get_choice_class('contactd_leader'))"
    )
    shown = by_lerobot(program)
    assert "ContactdConfig" in shown
    assert "ContactdLeaderConfig" in shown


PAUSES = """
import sys, time
from contactd_client import Client, ControlError
from lerobot_robot_contactd import Contactd, ContactdConfig

robot = Contactd(ContactdConfig(socket=sys.argv[1], id="x"))
robot.connect()
seen = robot.get_observation()
action = {f"{joint}.pos": seen[f"{joint}.pos"] for joint in robot.joints}

def act():
    for _ in range(25):
        robot.send_action(action)
        time.sleep(0.02)

act()
time.sleep(1.0)
act()
print("goes on")
with Client(sys.argv[1]) as other:
    other.ask({"command": "stop"})
try:
    act()
except ControlError as error:
    print(error)
"""


@needs_lerobot
def test_after_a_pause_the_arm_follows_on_and_after_a_stop_it_does_not() -> None:
    with pair(DESK_ARM) as arm:
        client, _, _ = arm.subscribed()
        client.close()
        with Client(arm.door, 10.0) as asking:
            assert asking.request("enable").ok
            now = asked_until(asking.ask_status, lambda now: now.mode == "holding", 10.0)
        assert now.mode == "holding"
        goes_on, ended = by_lerobot(PAUSES, arm.door).splitlines()
    assert goes_on == "goes on"
    assert "stop" in ended
