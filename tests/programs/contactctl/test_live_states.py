"""`contactctl record` and `watch` against a daemon that streams."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from programs.clients.log_reader import read_log
from programs.contactctl import contactctl
from tests.fake_daemon import state_at

ROOT = Path(contactctl.__file__).parents[2]
Run = Callable[..., Result]


def contactctl_process(fake_daemon: Any, *arguments: str, **options: Any) -> Any:
    program = "from programs.contactctl.contactctl import main; main()"
    command = [sys.executable, "-c", program, "--socket", str(fake_daemon.path), *arguments]
    return subprocess.Popen(command, cwd=ROOT, **options)


@contextmanager
def watched(fake_daemon: Any, **environment: str) -> Iterator[tuple[Any, int]]:
    """`contactctl watch` on a terminal: the process, and the terminal's descriptor."""
    ours, theirs = pty.openpty()
    own = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    own |= {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30", **environment}
    at = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    process = contactctl_process(fake_daemon, "watch", **at, env=own)
    read_until(ours, b"LWristPitch")
    yield process, ours
    os.close(ours)
    os.close(theirs)


def read_until(descriptor: int, word: bytes) -> bytes:
    seen = b""
    deadline = time.monotonic() + 120  # on a busy machine; an end is what is waited for
    while word not in seen:
        assert time.monotonic() < deadline, seen
        if select.select([descriptor], [], [], 0.1)[0]:
            seen += os.read(descriptor, 1 << 16)
    return seen


@pytest.fixture
def keep_signals() -> Any:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("keep_signals")
def test_record(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "made.mcap"
    result = run("record", str(path), "--seconds", "0.5")
    assert (result.exit_code, result.stdout) == (0, f"{path}: 0.5 s, 51 states, 0 lost\n")
    assert len(list(read_log(path))) == 52
    again = run("record", str(path), "--seconds", "0.5")
    assert again.exit_code == 65
    assert "never overwritten" in again.stderr


@pytest.mark.parametrize("name", ["lead.cvs", "lead.txt", "lead", ".csv", "lead.mcap.gz"])
def test_record_takes_no_other_suffix(
    run: Run, fake_daemon: Any, tmp_path: Path, name: str
) -> None:
    result = run("record", str(tmp_path / name), "--seconds", "0.1")
    assert result.exit_code == 65
    assert result.stderr == f"contactctl: {tmp_path / name}: must end in .mcap or .csv\n"
    assert not list(tmp_path.glob("*lead*"))
    assert not fake_daemon.seen


@pytest.mark.usefixtures("keep_signals")
def test_record_takes_a_suffix_in_any_case(run: Run, tmp_path: Path) -> None:
    assert run("record", str(tmp_path / "A.CSV"), "--seconds", "0.1").exit_code == 0
    assert (tmp_path / "A.CSV").read_text().startswith("time_s,")


@pytest.mark.usefixtures("keep_signals")
def test_record_reports_that_the_daemon_fell_silent(
    run: Run, fake_daemon: Any, tmp_path: Path
) -> None:
    end = fake_daemon.tick + 300
    fake_daemon.states = lambda tick: state_at(tick) if tick < end else None
    result = run("--json", "record", str(tmp_path / "made.mcap"))
    assert result.exit_code == 69
    assert result.stderr == "contactctl: the daemon fell silent\n"
    assert json.loads(result.stdout)["states"] == len(list(read_log(tmp_path / "made.mcap"))) - 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_recording(fake_daemon: Any, tmp_path: Path, number: int) -> None:
    path = tmp_path / "made.mcap"
    process = contactctl_process(
        fake_daemon, "record", str(path), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    read_until(process.stderr.fileno(), b"Ctrl-C ends it")
    while not fake_daemon.seen:
        assert process.poll() is None
        time.sleep(0.01)
    enough = fake_daemon.tick + 200
    while fake_daemon.tick < enough:
        time.sleep(0.01)
    process.send_signal(number)
    said, _ = process.communicate(timeout=10)
    assert process.returncode == 0
    states = len(list(read_log(path))) - 1
    assert states > 10
    assert f"{states} states, 0 lost" in said.decode()


@pytest.mark.parametrize("no_color", [False, True])
def test_watch_on_a_terminal(fake_daemon: Any, no_color: bool) -> None:
    with watched(fake_daemon, **({"NO_COLOR": "1"} if no_color else {})) as (process, terminal):
        seen = read_until(terminal, b"missed")
        process.send_signal(signal.SIGINT)
        seen += read_until(terminal, b"\x1b[?1049l")  # leaves the alternate screen
        assert process.wait(10) == 0
    assert b"Traceback" not in seen
    assert (b"\x1b[1;31m" in seen or b"[32m" in seen) is not no_color


@pytest.mark.parametrize("how", ["silent", "gone"])
def test_watch_reports_the_last_known_state(fake_daemon: Any, how: str) -> None:
    with watched(fake_daemon) as (process, terminal):
        if how == "silent":
            fake_daemon.states = lambda tick: None
            seen = read_until(terminal, b"was ")
            seen += read_until(terminal, b"no data for")
            assert b"\x1b[?1049l" not in seen  # in good time: the picture is still there
            why = b"the daemon fell silent"
        else:
            fake_daemon.stopped.set()
            why = b"no contactd serves"
        seen = read_until(terminal, b"use the emergency stop if")
        assert process.wait(10) == 69
    seen = seen[seen.rindex(b"\x1b[?1049l") :]
    assert why in seen
    assert b"last known: " in seen


def test_watch_json_ends_with_its_pipe(fake_daemon: Any) -> None:
    process = contactctl_process(
        fake_daemon, "--json", "watch", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    ticks = [json.loads(process.stdout.readline())["tick"] for _ in range(5)]
    assert ticks == list(range(ticks[0], ticks[0] + 5))
    process.stdout.close()
    assert process.wait(10) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
