"""`contactctl follow` and the keyboard as a leader: targets that they send, and a simulated arm
that follows in real time."""

import itertools
import os
import pty
import select
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import DESK_ARM
from bench.rigs.processes import Pair, pair
from common.errors import ControlError
from daemon.motion.trajectory_file import read_trajectory
from programs.clients.client import Client
from programs.contactctl import contactctl
from programs.contactctl import follow as command

ROOT = Path(__file__).resolve().parents[3]
TIMEOUT_S = 30.0


class Clock:
    """Time that passes by sleeping."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def test_a_file_is_sent_at_its_speed_and_other_joints_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake_daemon: Any
) -> None:
    clock = Clock()
    monkeypatch.setattr(command, "time", clock)
    (tmp_path / "way.csv").write_text("time_s,b\n1.0,0.0\n2.0,0.5\n")
    with Client(fake_daemon.path) as client:
        status = client.ask_status()
    b = status.joints[1]
    (tmp_path / "way.csv").write_text(f"time_s,{b}\n1.0,0.0\n2.0,0.5\n")
    file = read_trajectory(tmp_path / "way.csv", status.joints)
    sent = list(command._of_file(file, status, 20.0, lambda: True))
    assert [one.time_s for one in sent[:3]] == [0.0, 0.05, 0.1]
    assert [one.q[1] for one in sent[:3]] == pytest.approx([0.0, 0.025, 0.05])
    assert sent[-1].q[1] == 0.5
    assert {one.q[0] for one in sent} == {status.link_position[0]}
    assert clock.now_s - 100.0 == pytest.approx(1.0 + command.REST_S, abs=0.11)
    joins = iter([False, False, True])
    waits = command._of_file(file, status, 20.0, lambda: next(joins))
    assert [next(waits).q[1] for _ in range(5)] == pytest.approx([0.0, 0.0, 0.0, 0.025, 0.05])


class FakeStream:
    """Stream that records, and whose phase changes with its third target."""

    def __init__(self) -> None:
        self.sent: list[list[float]] = []
        self.rejoined: list[list[float]] = []

    def to(self, q: list[float], velocity: object, sent_s: float) -> None:
        del velocity, sent_s
        self.sent.append(q)

    def rejoin(self, q: list[float], sent_s: float) -> None:
        del sent_s
        self.rejoined.append(q)
        if len(self.rejoined) == 1:
            raise ControlError("out of reach")

    @property
    def state(self) -> dict[str, Any]:
        phase = "joining" if len(self.sent) < 3 else "following"
        return {"phase": phase, "contact": "contact of 1 Nm at b" if len(self.sent) > 4 else ""}

    @property
    def reply(self) -> dict[str, Any]:
        warnings = {"warnings": ["b moves at up to 2 rad/s"]} if len(self.sent) > 3 else {}
        return {"stream": self.state, "armed": True, **warnings}


def test_each_phase_is_shown_once_and_enter_rejoins(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entered = itertools.chain([False, True, True], itertools.repeat(False))
    monkeypatch.setattr(command, "_entered", lambda: next(entered))
    stream = FakeStream()
    command._send(iter([command.SentTarget([float(k)], None, float(k)) for k in range(6)]), stream)  # type: ignore[arg-type]
    assert stream.rejoined == [[1.0], [2.0]]
    shown = capsys.readouterr()
    assert [line.partition(":")[0] for line in shown.out.splitlines()] == [
        "joining",
        "following",
        "following",
    ]
    assert shown.out.endswith("; b is touched\n")
    assert shown.err == "out of reach\n  warning: b moves at up to 2 rad/s\n"


@pytest.mark.parametrize("words", [[], ["way.csv", "--leader", "x.sock"]])
def test_exactly_one_source_is_required(words: list[str]) -> None:
    result = CliRunner().invoke(contactctl.main, ["follow", *words])
    assert result.exit_code == 2
    assert "give either a FILE.csv or --leader SOCKET" in result.stderr


def test_a_leader_with_other_joints_is_refused(fake_daemon: Any) -> None:
    with pytest.raises(ControlError, match="names and order must be the same"):
        next(command._of_leader(fake_daemon.path, Path("other.sock"), ["x"]))


def test_an_arm_is_not_its_own_leader() -> None:
    with pytest.raises(ControlError, match="is this arm itself"):
        next(command._of_leader(Path("a.sock"), Path("a.sock"), ["x"]))


# --- in real time -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm() -> Iterator[Pair]:
    """Simulated desk arm, enabled."""
    with pair(DESK_ARM) as both:
        client, _, _ = both.subscribed()
        client.close()
        with Client(both.door, TIMEOUT_S) as asking:
            assert asking.request("enable").ok
            deadline = time.monotonic() + TIMEOUT_S
            while asking.ask_status().mode != "holding" and time.monotonic() < deadline:
                time.sleep(0.1)
        yield both


def place(arm: Pair) -> list[float]:
    with Client(arm.door, TIMEOUT_S) as client:
        return client.ask_status().link_position


def test_the_arm_follows_a_file(arm: Pair, tmp_path: Path) -> None:
    begun = place(arm)
    rows = "".join(f"{t / 10},{begun[0] + 0.02 * t}\n" for t in range(11))
    (tmp_path / "way.csv").write_text(f"time_s,column\n{rows}")
    words = ["--socket", str(arm.door), "follow", str(tmp_path / "way.csv"), "--rate", "100"]
    result = CliRunner().invoke(contactctl.main, words, catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    assert "following: the arm follows" in result.stdout
    assert place(arm)[0] == pytest.approx(begun[0] + 0.2, abs=0.03)


def test_the_arm_follows_the_keyboard(arm: Pair) -> None:
    """Held down, the right arrow moves the first joint until q ends it."""
    with Client(arm.door, TIMEOUT_S) as client:
        deadline = time.monotonic() + TIMEOUT_S
        while client.ask_status().mode != "holding" and time.monotonic() < deadline:
            time.sleep(0.1)
    begun = place(arm)[0]
    terminal, its_end = pty.openpty()
    termios.tcsetwinsize(terminal, (24, 80))
    words = [sys.executable, str(ROOT / "docs/programs/keyboard_leader.py"), str(arm.door)]
    environment = {**os.environ, "TERM": "xterm", "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        words, stdin=its_end, stdout=its_end, stderr=its_end, env=environment
    ) as leader:
        os.close(its_end)
        try:
            seen = shown(terminal)
            deadline = time.monotonic() + TIMEOUT_S
            while "following" not in seen and time.monotonic() < deadline:
                seen += shown(terminal)
            for _ in range(40):
                os.write(terminal, b"\x1bOC")
                shown(terminal)
            os.write(terminal, b"q")
            assert leader.wait(TIMEOUT_S) == 0, seen
        finally:
            leader.kill()
            os.close(terminal)
    assert place(arm)[0] - begun > 0.05


def shown(terminal: int) -> str:
    """Text that a program has written to its terminal, after 0.03 s."""
    written = select.select([terminal], [], [], 0.03)[0]
    time.sleep(0.03)
    return os.read(terminal, 65536).decode(errors="replace") if written else ""
