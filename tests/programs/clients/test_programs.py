"""Programs of docs/programs.md, as a user would run them; and the schemas of messages."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from hatchling.builders.wheel import WheelBuilder

import hatch_build
from contactd_client.paths import view_socket_path
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request
from daemon.protocol.state import State
from tests.fake_daemon import state_at

ROOT = Path(__file__).resolve().parents[3]
PROGRAMS = ROOT / "docs/programs"
LONGEST_S = 60.0


@pytest.fixture
def view(fake_daemon: Any) -> Path:
    """View socket of a daemon whose arm is touched every 50 ticks, and collides every 200."""
    notices = state_at(100).notices
    (contact,) = notices
    collision = msgspec.structs.replace(
        contact, contact=msgspec.structs.replace(contact.contact, level="collision")
    )

    def state(tick: int) -> State:
        if tick % 50:
            return state_at(tick, notices=[])
        return state_at(tick, notices=[collision if tick % 200 == 0 else contact])

    fake_daemon.states = state
    return view_socket_path(fake_daemon.path)


class Program:
    """A running program, whose lines are taken one by one."""

    def __init__(self, *words: str) -> None:
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        environment = {"PATH": path, "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,  # with all that it starts
        )
        self._guard = threading.Timer(LONGEST_S, self._kill)
        self._guard.start()

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().rstrip("\n")

    def end(self) -> tuple[int, str]:
        """Exit status, and what it said on stderr."""
        _, said = self.process.communicate()
        return self.process.returncode, said

    def close(self) -> None:
        self._guard.cancel()
        self._kill()
        self.process.communicate()

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


@pytest.fixture
def start() -> Iterator[Callable[..., Program]]:
    started: list[Program] = []

    def begin(*words: Any) -> Program:
        started.append(Program(*[str(word) for word in words]))
        return started[-1]

    yield begin
    for program in started:
        program.close()


def seen(fake_daemon: Any, command: str) -> None:
    """Wait until the daemon was asked this."""
    end_s = time.monotonic() + LONGEST_S
    while command not in [asked for asked, _ in fake_daemon.seen]:
        assert time.monotonic() < end_s, f"no one asked for {command}"
        time.sleep(0.001)


def test_standard_library(fake_daemon: Any, view: Path, start: Any) -> None:
    program = start(sys.executable, "-I", PROGRAMS / "contacts.py", view)
    for _ in range(3):
        assert program.line().endswith(" s LShoulderYaw -1.30 Nm")
    assert "stop" not in [command for command, _ in fake_daemon.seen]
    fake_daemon.stopped.set()
    assert program.end() == (1, "the daemon ended\n")


def test_a_missing_daemon_is_reported(start: Any) -> None:
    program = start(sys.executable, PROGRAMS / "contacts.py", "/nowhere")
    assert program.end() == (1, "/nowhere: No such file or directory\n")
    usage = "usage: contacts.py VIEW_SOCKET [--stop]\n"
    assert start(sys.executable, PROGRAMS / "contacts.py").end() == (1, usage)
    program = start(sys.executable, "-u", PROGRAMS / "contacts_asyncio.py", "/nowhere")
    assert program.process.stderr is not None
    said = program.process.stderr.readline()
    assert said.startswith("nothing is known of the arm: no contactd serves /nowhere")


def test_a_daemon_that_hangs_is_reported(start: Any, tmp_path: Path) -> None:
    """It accepts connections, and answers none."""
    where = tmp_path / "hangs"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(where))
        listener.listen()
        program = start(sys.executable, PROGRAMS / "contacts.py", where)
        said = "the daemon fell silent: nothing is known of the arm\n"
        assert program.end() == (1, said)


def test_standard_library_stops_at_a_collision(fake_daemon: Any, view: Path, start: Any) -> None:
    start(sys.executable, "-I", PROGRAMS / "contacts.py", view, "--stop")
    seen(fake_daemon, "stop")


def test_the_client(fake_daemon: Any, view: Path, start: Any) -> None:
    program = start(sys.executable, PROGRAMS / "contacts_client.py", view)
    assert program.line().startswith("joined contactd 0.1.0: LShoulderPitch, ")
    assert program.line() == "LShoulderYaw -1.30 Nm"
    fake_daemon.stopped.set()
    while (line := program.line()) == "LShoulderYaw -1.30 Nm":
        pass
    assert line.startswith("nothing is known of the arm: ")


def test_asyncio_stops_at_the_first_contact(fake_daemon: Any, view: Path, start: Any) -> None:
    program = start(sys.executable, PROGRAMS / "contacts_asyncio.py", view)
    assert program.line() == "stop done"
    assert program.end() == (0, "")
    assert "stop" in [command for command, _ in fake_daemon.seen]


@pytest.mark.skipif(not shutil.which("jq"), reason="needs jq")
def test_shell(fake_daemon: Any, view: Path, start: Any) -> None:
    program = start("sh", PROGRAMS / "contacts.sh", view)
    words = program.line().split()
    assert words[1:] in (["LShoulderYaw", "-1.3", level] for level in ("contact", "collision"))


@pytest.mark.skipif(not shutil.which("node"), reason="needs node")
def test_node(fake_daemon: Any, view: Path, start: Any) -> None:
    program = start("node", PROGRAMS / "contacts.mjs", view)
    assert program.line().split()[1:3] == ["LShoulderYaw", "-1.3"]
    fake_daemon.stopped.set()
    status, said = program.end()
    assert status == 69
    assert "contactctl: the daemon closed the connection" in said


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """The program in C."""
    made, source = tmp_path / "contacts", str(PROGRAMS / "contacts.c")
    words = [*hatch_build.compiler(), "-Wall", "-Wextra", "-Werror", "-o", str(made), source]
    subprocess.run(words, check=True)
    return made


def test_c(fake_daemon: Any, view: Path, start: Any, built: Path) -> None:
    assert len((PROGRAMS / "contacts.c").read_text().splitlines()) <= 60
    program = start(built, view)
    word, tick = program.line().split()
    assert (word, int(tick) % 50) == ("tick", 0)
    fake_daemon.stopped.set()
    assert program.end() == (1, "contacts: the daemon ended\n")
    assert start(built, "/nowhere").end() == (1, "contacts: /nowhere: No such file or directory\n")
    assert start(built, "x" * 200).end()[0] == 1


def test_the_c_program_prints_the_reason_of_a_refusal(
    fake_daemon: Any, view: Path, start: Any, built: Path
) -> None:
    fake_daemon.refusals["subscribe"] = ["too early"]
    status, said = start(built, view).end()
    assert status == 1
    assert "too early" in said


def test_the_client_is_a_package_of_its_own(tmp_path: Path, start: Any, view: Path) -> None:
    """Built as pip builds it, and run where there is nothing else."""
    (made,) = WheelBuilder(str(ROOT / "contactd_client")).build(directory=str(tmp_path))
    with zipfile.ZipFile(made) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
        metadata = wheel.read(next(n for n in wheel.namelist() if n.endswith("/METADATA"))).decode()
        wheel.extractall(tmp_path / "elsewhere")
    sources = {path.name for path in (ROOT / "contactd_client").glob("*.py")} | {"py.typed"}
    assert names == {f"contactd_client/{name}" for name in sources}
    assert "Requires-Dist" not in metadata
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'elsewhere')!r}); "
        f"from contactd_client import Client; print(Client(sys.argv[1]).status()['pid'])"
    )
    assert start(sys.executable, "-I", "-S", "-W", "ignore", "-c", program, view).line() == "4711"


# --- schemas -----------------------------------------------------------------------------------


def validator(name: str) -> jsonschema.Draft202012Validator:
    schema = json.loads((ROOT / f"docs/schemas/{name}.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_messages_of_a_daemon_fit_the_schemas(served: Any) -> None:
    """Messages of a whole daemon in lockstep: States, Status, Snapshot, refusals."""
    replies, states = validator("reply"), validator("state")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as reader:
        reader.connect(str(served.path))
        for command in ("status", "arm", "enable", "subscribe"):
            reader.send(json.dumps({"command": command}).encode())
            reply = json.loads(served.until(lambda: reader.recv(2 << 20)))
            replies.validate(reply)
            assert reply["ok"] is (command != "arm")
        for _ in range(20):
            states.validate(json.loads(served.until(lambda: reader.recv(2 << 20))))


REQUESTS = [
    ({"command": "stop", "on_behalf_of": "planner 3"}, True),
    ({"command": "arm", "lease_s": 0.5}, True),
    ({"command": "arm", "lease_s": 0}, False),
    ({"command": "arm", "lease_s": 86_401}, False),
    ({"command": "load", "header": {"name": "a\nb", "joints": []}}, False),
    ({"command": "load", "header": {"name": "wave", "joints": ["A"]}, "rows": [[0, 1, 2]]}, True),
    ({"command": "stop", "on_behalf_of": 'a"b'}, False),
    ({"command": "stop", "on_behalf_of": "x" * 65}, False),
    ({"command": "fly"}, False),
    ({"command": "stop", "now": True}, False),
    ({}, False),
]


@pytest.mark.parametrize(("request_", "fits"), REQUESTS)
def test_the_schema_accepts_the_requests_that_the_daemon_accepts(
    request_: dict[str, Any], fits: bool
) -> None:
    assert validator("request").is_valid(request_) is fits
    try:
        msgspec.convert(request_, Request)
    except msgspec.ValidationError:
        assert not fits
    else:
        assert fits


@pytest.mark.parametrize(
    ("name", "cls", "message"),
    [("reply", Reply, {"ok": "yes"}), ("state", State, {"tick": 1}), ("reply", Reply, [])],
)
def test_invalid_messages_do_not_fit_the_schemas(name: str, cls: type, message: Any) -> None:
    assert not validator(name).is_valid(message)
