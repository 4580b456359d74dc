"""`contactctl` where a command that is to bring the arm to rest does not reach the daemon."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner, Result

from daemon.modes.table import Mode
from daemon.protocol.replies import PlannedPath, Reply
from programs.clients.client import Client
from programs.command_line.options import Options
from programs.contactctl import contactctl, go

AT_ONCE = "contactctl: NOT REACHED: use the emergency stop. ("
COMMANDS = ["stop", "disarm", "disable", "pause"]
Answer = Callable[[str], bytes | None]


def say(path: Path, *words: str) -> Result:
    arguments = ["--socket", str(path), *words]
    return CliRunner().invoke(contactctl.main, arguments, catch_exceptions=False)


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Options, "connect", lambda options: Client(options.socket, 0.2))


@contextmanager
def answering(path: Path, answer: Answer) -> Iterator[None]:
    """A socket whose every request gets what `answer` says to its command; None: none, and b"": the
    connection is closed."""

    def serve() -> None:
        while True:
            try:
                client, _ = listening.accept()
            except OSError:
                return
            kept.append(client)
            while packet := client.recv(1 << 16):
                said = answer(msgspec.json.decode(packet)["command"])
                if said == b"":
                    client.close()
                    break
                if said is not None:
                    client.send(said)

    kept: list[socket.socket] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(path))
        listening.listen()
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            thread.join()
            for client in kept:
                client.close()


@pytest.mark.parametrize("no_wait", [(), ("--no-wait",)])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_daemon_is_reported(
    tmp_path: Path, command: str, no_wait: tuple[str, ...]
) -> None:
    result = say(tmp_path / "nothing", command, *no_wait)
    assert result.exit_code == 69
    assert result.stderr.startswith(f"{AT_ONCE}no contactd serves {tmp_path / 'nothing'}: ")


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (None, "the daemon does not answer; is it still starting?"),
        (b"", "the daemon closed the connection"),
    ],
)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_answer_is_reported(tmp_path: Path, command: str, answer: Any, why: str) -> None:
    with answering(tmp_path / "control", lambda _: answer):
        result = say(tmp_path / "control", command)
    assert (result.exit_code, result.stderr) == (69, f"{AT_ONCE}{why})\n")


def test_an_answer_of_another_version_is_reported(tmp_path: Path) -> None:
    with answering(tmp_path / "control", lambda _: b"{"):
        result = say(tmp_path / "control", "stop")
    assert result.exit_code == 1
    assert result.stderr.startswith(f"{AT_ONCE}the daemon has another version")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_stop_that_was_given_before_the_daemon_fell_silent(tmp_path: Path, command: str) -> None:
    taken = msgspec.json.encode(Reply(ok=True, mode=Mode.STOPPING, unproved=["LElbowRoll"]))
    with answering(tmp_path / "control", lambda asked: taken if asked == command else None):
        result = say(tmp_path / "control", command)
    assert result.exit_code == 69
    assert result.stderr == (
        f"contactctl: {command} is given, but the arm is not seen to stand: use the emergency stop "
        "if it moves. (the daemon does not answer; is it still starting?)\n"
    )


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_daemon_that_falls_silent_on_the_way_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupted: bool
) -> None:
    @contextmanager
    def _interrupted() -> Iterator[Callable[[], bool]]:
        yield lambda: interrupted

    monkeypatch.setattr(go, "_interrupted", _interrupted)
    way = PlannedPath(
        name="zero", joints=["one"], start=[0.0], goal=[1.0], speed=[0.2], duration_s=5.0
    )
    moves = msgspec.json.encode(Reply(ok=True, mode=Mode.TRACKING, way=way))
    with answering(tmp_path / "control", lambda asked: moves if asked == "go" else None):
        result = say(tmp_path / "control", "go", "zero", "--yes")
    end = "." if interrupted else " if the arm moves."
    said = f"contactctl: NOT REACHED: use the emergency stop{end} (the daemon does not answer; "
    assert result.exit_code == 69
    assert result.stderr.startswith(said)


@pytest.mark.parametrize("command", ["status", "start", "enable", "record x.mcap"])
def test_commands_that_stop_nothing_report_only_the_reason(tmp_path: Path, command: str) -> None:
    result = say(tmp_path / "nothing", *command.split())
    assert result.exit_code == 69
    assert result.stderr.startswith("contactctl: no contactd serves ")
