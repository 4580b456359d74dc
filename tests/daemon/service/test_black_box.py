"""Frames of the last minute: in a log after a fault or a crash, and none after an orderly end."""

import fcntl
import grp
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import pytest
from click.testing import CliRunner, Result

from common.errors import LogError
from daemon.protocol.doors import DOORS, Door
from daemon.service import black_box, black_box_log
from daemon.service.black_box import BlackBox, ring_path
from daemon.service.black_box_log import follow, save, save_left_over, write_log
from drivers.can.frame_ring import FrameRing, Recorded
from drivers.can.wire import ERROR, EXTENDED, REMOTE
from programs.contactd.contactd import main

FRAMES = [
    Recorded(1_700_000_000.25, 0x181, b"\x27\x02", False),
    Recorded(1_700_000_000.26, 0x201, b"\x0f\x00\x01", True),
    Recorded(1_700_000_000.27, 0x12345 | EXTENDED, b"", False),
    Recorded(1_700_000_000.28, 0x701 | REMOTE, b"", False),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "control.frames"


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    return tmp_path / "state"


def filled(path: Path, number: int = 3) -> None:
    ring = FrameRing(path, 100, time.monotonic)
    for k in range(number):
        ring.put(time.monotonic(), 0x181 + k, bytes([k]), k % 2 == 1)
    ring.close()


def saved(logs: Path) -> list[Path]:
    """Logs that are complete."""
    return list(logs.glob("[!.]*.blf"))


def wait_for(done: Callable[[], object]) -> None:
    end = time.monotonic() + 20.0
    while not done() and time.monotonic() < end:
        time.sleep(0.05)


def command(socket: Path, *more: str) -> Result:
    """Result of `contactd black-box`."""
    return CliRunner().invoke(main, ["black-box", "--socket", str(socket), *more])


def ids(log: Path) -> list[int]:
    with can.LogReader(str(log)) as frames:
        return [frame.arbitration_id for frame in frames]


@pytest.mark.parametrize("suffix", [".blf", ".log", ".LOG"])
def test_a_log_of_python_can(tmp_path, suffix):
    target = write_log(FRAMES, tmp_path / f"x{suffix}")
    with can.LogReader(str(target)) as log:
        for frame, message in zip(FRAMES, log, strict=True):
            assert message.timestamp == pytest.approx(frame.time_s, abs=1e-4)
            assert message.arbitration_id == frame.can_id & 0x1FFF_FFFF
            assert message.is_extended_id == bool(frame.can_id & EXTENDED)
            assert message.is_remote_frame == bool(frame.can_id & REMOTE)
            assert bytes(message.data) == frame.data
            assert message.is_rx is not frame.sent
    assert list(tmp_path.iterdir()) == [target]


def test_error_frames_keep_their_class(tmp_path):
    target = write_log([Recorded(1.0, 0x40 | ERROR, bytes(8), False)], tmp_path / "x.blf")
    with can.LogReader(str(target)) as log:
        (message,) = log
    assert message.is_error_frame
    assert message.arbitration_id == 0x40


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x.exe", "{}: must end in .blf, .log or .asc"),
        ("x.txt", "{}: must end in .blf, .log or .asc"),
        ("x.log.gz", "{}: must end in .blf, .log or .asc"),
        ("folder", "{}: must end in .blf, .log or .asc"),
        ("folder/there.log", "{} exists: it is never overwritten"),
        ("folder/there.blf", "{} exists: it is never overwritten"),
        ("nowhere/x.blf", "cannot write {}: No such file or directory"),
        ("folder/there.log/x.blf", "cannot write {}: Not a directory"),
        (f"{250 * 'x'}.blf", "cannot write {}: File name too long"),
    ],
)
def test_a_refused_log_changes_no_file(tmp_path, name, words):
    folder = tmp_path / "folder"
    (folder / "there.blf").mkdir(parents=True)
    (folder / "there.log").write_text("evidence")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(LogError) as caught:
        write_log(FRAMES, tmp_path / name)
    assert str(caught.value) == words.format(tmp_path / name)
    assert sorted(tmp_path.rglob("*")) == before
    assert (folder / "there.log").read_text() == "evidence"


def test_a_full_disk_leaves_no_partial_log(tmp_path, monkeypatch):
    def full(_: str) -> None:
        (tmp_path / ".x.blf.partial.blf").touch()
        raise OSError(28, "No space left on device", ".x.blf.partial.blf")

    monkeypatch.setattr(can, "Logger", full)
    with pytest.raises(LogError, match=r"cannot write .*/x\.blf: No space left on device$"):
        write_log(FRAMES, tmp_path / "x.blf")
    assert not list(tmp_path.iterdir())


def test_old_logs_are_removed(path, logs):
    filled(path)
    logs.mkdir()
    for k in range(30):
        (logs / f"frames-2020{k:02}.000Z.blf").touch()
    kept = save(path, logs)
    names = sorted(log.name for log in logs.iterdir())
    assert kept is not None
    assert len(names) == black_box_log.LOGS_KEPT
    assert names[-1] == kept.name
    assert ids(kept) == [0x181, 0x182, 0x183]


def helper(path: Path, logs: Path, *said: bytes) -> list[str]:
    """Run the helper until the pipe ends, which is after the last words."""
    reported: list[str] = []
    reader, writer = os.pipe()
    thread = threading.Thread(target=follow, args=(path, logs, reader, reported.append))
    thread.start()
    for words in said:
        os.write(writer, words)
        time.sleep(0.05)
    os.close(writer)
    thread.join(10)
    os.close(reader)
    return reported


@pytest.mark.parametrize(
    ("said", "logs_written"),
    [
        ([b"ended\n"], 0),
        ([], 1),  # killed
        ([b"drive fault: x\n", b"bus trouble\n", b"ended\n"], 1),
        ([b"drive fault: x\nended\n"], 1),
        ([b"drive fault: x\n"], 1),  # and killed in its aftermath
    ],
)
def test_one_log_for_a_fault_or_a_crash_and_none_for_an_orderly_end(path, logs, said, logs_written):
    filled(path)
    reported = helper(path, logs, *said)
    assert len(reported) == logs_written
    assert len(saved(logs)) == logs_written
    assert not path.exists(), "the ring is removed"


def test_a_fault_waits_for_its_aftermath_and_the_next_is_another(path, logs, monkeypatch):
    monkeypatch.setattr(black_box_log, "AFTERMATH_S", 0.01)
    filled(path)
    assert len(helper(path, logs, b"one\n", b"two\n", b"ended\n")) == 2


def test_a_helper_leaves_the_ring_of_the_next_daemon_alone(path, logs, monkeypatch):
    filled(path)
    written = black_box_log.save

    def late(*arguments):
        filled(path)  # the next daemon has started meanwhile
        return written(*arguments)

    monkeypatch.setattr(black_box_log, "save", late)
    helper(path, logs)
    assert path.exists()


def test_a_ring_without_frames_makes_no_log(path, logs):
    filled(path, 0)
    assert helper(path, logs) == []
    assert not path.exists()


def test_a_ring_without_a_helper_is_saved(path, logs):
    assert save_left_over(path, logs) is None
    filled(path)
    with path.open("rb") as ring:
        fcntl.flock(ring, fcntl.LOCK_EX)
        assert save_left_over(path, logs, timeout_s=0.1) is None, "a helper holds it"
    saved = save_left_over(path, logs)
    assert saved is not None
    assert ids(saved) == [0x181, 0x182, 0x183]
    assert not path.exists()


def test_the_daemon_runs_without_a_place_for_the_black_box(path, tmp_path, caplog):
    (tmp_path / "state").write_text("a file")
    with BlackBox(path, tmp_path / "state", 10.0) as box:
        assert box.ring is None
        box.report("a fault")
    assert "no black box" in caplog.text


def test_an_orderly_end_with_the_real_helper(path, logs):
    with BlackBox(path, logs, 10.0) as box:
        assert box.ring is not None
        box.ring.put(time.monotonic(), 0x181, b"", False)
    assert not path.exists()
    assert not list(logs.iterdir())


def test_kill_9_with_the_real_helper(path, logs):
    program = (
        "import os, signal, sys, time; from pathlib import Path\n"
        "from daemon.service.black_box import BlackBox\n"
        "box = BlackBox(Path(sys.argv[1]), Path(sys.argv[2]), 10.0)\n"
        "for k in range(300): box.ring.put(time.monotonic(), 0x200 + k, b'abc', True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path), str(logs)], check=False)
    assert done.returncode == -signal.SIGKILL
    wait_for(lambda: not path.exists())
    (log,) = saved(logs)
    assert ids(log) == [0x200 + k for k in range(300)]


@pytest.mark.parametrize("begun", [False, True])
def test_a_start_that_failed_leaves_no_log(path, logs, begun, monkeypatch):
    monkeypatch.setattr(black_box, "FAULTED_TIMEOUT_S", 20.0)  # this machine may be busy

    def fail():
        with BlackBox(path, logs, 10.0) as box:
            box.ring.put(time.monotonic(), 0x581, b"", False)
            if begun:
                box.begin()
            raise OSError("a drive does not answer")

    with pytest.raises(OSError, match="does not answer"):
        fail()
    wait_for(lambda: not path.exists())
    assert len(saved(logs)) == int(begun)


def test_a_helper_that_was_killed_is_restarted_and_saves_the_fault(path, logs, caplog):
    with BlackBox(path, logs, 10.0) as box:
        box.begin()
        box.ring.put(time.monotonic(), 0x181, b"", False)
        first = box._helper
        first.kill()
        first.wait()
        for _ in range(15):
            box.report("heartbeat lost")
        assert not caplog.records
        box.look_after(100.0)
        assert box._helper is not first
        assert caplog.messages == ["the black box's helper ended (-9): restarting it"]
        wait_for(lambda: saved(logs))
        (log,) = saved(logs)
        box._helper.kill()
        box._helper.wait()
        box.look_after(101.0)
        assert len(caplog.records) == 1, "not all the time"
        box.look_after(110.0)
        assert len(caplog.records) == 2
    assert ids(log) == [0x181]


# A helper that holds the ring and does not get on with its log.
BUSY = (
    "import fcntl, sys, time; ring = open(sys.argv[1], 'rb'); fcntl.flock(ring, fcntl.LOCK_EX)\n"
    "print('busy', flush=True); time.sleep(60)"
)


def test_a_faulted_daemon_ends_before_a_slow_log_is_written(path, logs, monkeypatch, caplog):
    helpers, waited = [], []

    def start(ring, _):
        helpers.append(
            subprocess.Popen(
                [sys.executable, "-c", BUSY, str(ring)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
        )
        assert helpers[-1].stdout.readline() == b"busy\n"
        return helpers[-1]

    wait = subprocess.Popen.wait
    monkeypatch.setattr(
        subprocess.Popen, "wait", lambda self, timeout: waited.append(timeout) or wait(self, 0.01)
    )
    monkeypatch.setattr(black_box, "_start_helper", start)
    box = BlackBox(path, logs, 10.0)
    box.ring.put(time.monotonic(), 0x181, b"", False)
    box.close(orderly=False)
    monkeypatch.undo()
    (helper,) = helpers
    assert waited == [1.0]
    assert helper.poll() is None, "it goes on alone"
    assert "still being written" in caplog.text
    helper.kill()  # as systemd does
    helper.wait()
    helper.stdout.close()
    with BlackBox(path, logs, 10.0):
        (log,) = saved(logs)
    assert ids(log) == [0x181], "saved at the next start"


def test_the_ring_is_open_to_the_group_of_the_socket(path, logs, monkeypatch):
    if os.getuid() != 0:
        pytest.skip("only root may give a file to any group")
    other = next(g for g in grp.getgrall() if g.gr_gid != os.getgid())
    rule = replace(DOORS[Door.CONTROL], group=other.gr_name)
    monkeypatch.setitem(DOORS, Door.CONTROL, rule)
    with BlackBox(path, logs, 10.0):
        assert path.stat().st_gid == other.gr_gid
        assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("more", [[], ["--left-over"]])
def test_a_user_who_may_not_read_the_ring_is_reported_its_group(tmp_path, monkeypatch, more):
    def denied(path, **_):
        raise PermissionError(13, "Permission denied", str(path))

    ring = ring_path(tmp_path / "control")
    filled(ring)
    monkeypatch.setattr("programs.contactd.black_box.open_regular", denied)
    monkeypatch.setattr(Path, "group", lambda _: "contact")
    result = command(tmp_path / "control", *more)
    assert result.exit_code == 69
    assert result.stderr.startswith(f"contactd: you may not use {ring}: join the group contact")


def link(path: Path) -> None:
    """Link to a ring."""
    filled(path.with_name("other"))
    path.symlink_to("other")


def bound_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(path))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        pytest.param(os.mkfifo, "is not a regular file", id="fifo"),
        pytest.param(link, "is a link, not a file", id="link"),
        pytest.param(lambda path: path.symlink_to("nothing"), "is a link, not a file", id="broken"),
        pytest.param(bound_socket, "is not a regular file", id="socket"),
        pytest.param(Path.mkdir, "Is a directory", id="folder"),
    ],
)
def test_another_file_in_place_of_the_ring_is_refused_without_waiting(
    tmp_path, logs, caplog, impatient, make, word
):
    ring = ring_path(tmp_path / "control")
    make(ring)
    before = ring.lstat()
    with BlackBox(ring, logs, 10.0) as box:
        assert box.ring is None
    (line,) = caplog.messages
    assert line == f"no black box: {ring}: {word}"
    assert ring.lstat().st_ino == before.st_ino, "it is left where it is"
    for more in ([], ["--left-over"]):
        result = command(tmp_path / "control", *more)
        assert result.exit_code == 65
        assert result.stderr.startswith(f"contactd: {ring}: "), result.stderr
    with pytest.raises((LogError, OSError), match=word):
        follow(ring, logs, -1, print)


def test_the_command_saves_the_ring_and_one_left_over(tmp_path, logs, monkeypatch):
    socket, output = tmp_path / "control", tmp_path / "now.log"
    filled(ring_path(socket))
    assert command(socket, "--output", str(output)).output == f"3 frames, 0.0 s: {output}\n"
    assert ids(output) == [0x181, 0x182, 0x183]
    monkeypatch.setenv("STATE_DIRECTORY", str(logs))
    assert command(socket, "--left-over").exit_code == 0
    assert len(list(logs.iterdir())) == 1
    result = command(socket, "--left-over")
    assert (result.exit_code, result.output) == (0, "")
    assert command(socket).exit_code == 65
