"""Commands that write a file where there is no room for it: nothing half-written is left, or it is
said what is left. A limit of the size of files stands for the disk."""

import errno
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from bench.rigs.lockstep import ROMEO
from common.errors import LogError
from common.new_file import whole_file
from daemon.protocol.trend_row import trends_folder
from programs.clients.log_reader import read_log
from programs.clients.truncated import truncated
from programs.contactd import contactd
from programs.trends.day import write_day
from tests.fake_daemon import snapshot_at, state_at
from tests.programs.clients.test_replay import written
from tests.programs.trends.test_findings import days, worn

ROOT = Path(contactd.__file__).parents[2]
CONTACTD = "from programs.contactd.contactd import main; main()"
CONTACTCTL = "from programs.contactctl.contactctl import main; main()"


def limited(room: int, program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Result of a command none of whose files may become larger than `room` [bytes]."""
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    urdf = (ROMEO / "arm.urdf").read_text()
    states = [state_at(k) for k in range(90, 400)]
    snapshot = msgspec.structs.replace(snapshot_at(89), urdf=urdf)
    return written(tmp_path / "made.mcap", [snapshot, *states])


@pytest.mark.parametrize(
    "words",
    [
        ["plot", "made.html"],
        ["plot", "made.png"],
        ["plot", "made.svg"],
        ["export", "--foxglove", "made-foxglove.mcap"],
        ["export", "--csv", "made.csv"],
        ["export", "--labels", "labels.csv"],
    ],
)
def test_nothing_half_written_is_left(recording: Path, tmp_path: Path, words: list[str]) -> None:
    command, *form, name = words
    folder = tmp_path / "made"
    folder.mkdir()
    target = folder / name
    room = 16 if "--labels" in form else 4096
    done = limited(room, CONTACTD, command, recording, *form, "-o", target)
    assert done.stderr == f"contactd: cannot write {target}: File too large\n"
    assert (done.returncode, list(folder.iterdir())) == (65, [])
    assert f": {target}\n" not in done.stdout


def test_no_half_picture_of_the_gears_is_left(tmp_path: Path) -> None:
    for day in days(5, worn):
        write_day(trends_folder(tmp_path / "state", "arm"), day)
    (folder := tmp_path / "made").mkdir()
    target = folder / "made.png"
    directory = ("--directory", tmp_path / "state")
    done = limited(4096, CONTACTCTL, "health", *directory, "--plot", target)
    assert done.stderr == f"contactctl: cannot write {target}: File too large\n"
    assert (done.returncode, list(folder.iterdir())) == (65, [])


def test_the_previous_file_stays(recording: Path, tmp_path: Path) -> None:
    target = tmp_path / "made.html"
    target.write_text("before")
    assert limited(4096, CONTACTD, "plot", recording, "-o", target).returncode == 65
    assert target.read_text() == "before"


def test_a_link_to_a_page_stays_one(tmp_path: Path) -> None:
    (tmp_path / "link.html").symlink_to("made.html")
    with whole_file(tmp_path / "link.html") as partial:
        partial.write_text("page")
    assert (tmp_path / "link.html").is_symlink()
    assert (tmp_path / "made.html").read_text() == "page"
    nowhere = tmp_path / "no" / "made.html"
    with pytest.raises(LogError, match="No such file") as caught, whole_file(nowhere) as partial:
        partial.write_text("page")
    assert str(caught.value).startswith(f"cannot write {nowhere}: ")


def test_a_pipe_is_neither_replaced_nor_removed(tmp_path: Path) -> None:
    pipe = tmp_path / "made.html"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with whole_file(pipe) as partial:
        partial.write_text("page")
    assert os.read(reader, 100) == b"page"
    os.close(reader)
    truncated(pipe, OSError(errno.ENOSPC, "No space left on device"), lambda path: False)
    assert pipe.is_fifo()


@pytest.mark.parametrize(
    ("name", "room", "left"),
    [
        ("made.mcap", 300_000, "it holds what was recorded until then"),
        ("made.mcap", 1000, "nothing was recorded"),
        ("made.csv", 9000, "it holds what was recorded until then"),
        ("made.csv", 0, "nothing was recorded"),
    ],
)
def test_a_recording_says_what_is_left(
    fake_daemon: Any, tmp_path: Path, name: str, room: int, left: str
) -> None:
    path = tmp_path / name
    done = limited(room, CONTACTCTL, "--socket", fake_daemon.path, "record", path)
    said = f"contactctl: cannot write {path}: File too large; {left}"
    assert (done.returncode, done.stderr.splitlines()[-1]) == (65, said)
    assert path.exists() is left.startswith("it holds")
    if path.exists() and name == "made.mcap":
        with pytest.raises(LogError, match="ends in the middle"):
            list(read_log(path))
    if path.exists() and name == "made.csv":
        head, *rows = path.read_text().splitlines()
        assert {row.count(",") for row in rows} == {head.count(",")}
        assert path.read_text().endswith("\n")
