"""Processes: `contactd run` beside `contactd simulate`, killed, stopped, and twice.

One simulated arm serves all tests, one daemon after the other; the last one loses it.
"""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from bench.rigs.lockstep import ROMEO
from common.errors import ControlError, UnreachableError
from daemon.protocol.replies import Status
from programs.clients.client import Client
from programs.clients.reload import reload

ROOT = Path(__file__).resolve().parents[2]
TIMEOUT_S = 120.0
"""An awaited event comes in a second; a machine beside many others may take a minute."""


def eventually(what: Callable[[], object], why: Callable[[], str]) -> None:
    """Wait for `what` on a machine that may be busy; never a maximum to hold."""
    deadline = time.monotonic() + TIMEOUT_S
    while not what():
        assert time.monotonic() < deadline, why()
        time.sleep(0.02)


@dataclass
class Simulator:
    """A simulated arm in a process of its own."""

    process: subprocess.Popen[str]
    port: int
    robot: Path
    reported: list[str] = field(default_factory=list)
    """Events of its drives, as printed."""

    def drives_that(self, did: str) -> int:
        return len({line.split(":")[0] for line in self.reported if did in line})


@dataclass
class Daemon:
    """A daemon, and a person who talks to it."""

    process: subprocess.Popen[str]
    door: Path

    def ask(self, command: str) -> list[str]:
        """The reasons of a refusal."""
        with Client(self.door) as client:
            return client.request(command).reasons  # type: ignore[arg-type]

    def mode(self) -> str:
        try:
            with Client(self.door) as client:
                return client.request("status").mode
        except UnreachableError:
            return "silent"

    def becomes(self, mode: str) -> None:
        eventually(lambda: self.mode() == mode, lambda: f"{self.mode()}, not {mode}")

    def moves(self) -> None:
        """Enable, and get on the trajectory."""
        assert self.ask("enable") == []
        self.becomes("holding")
        assert self.ask("start") == []
        self.becomes("tracking")
        time.sleep(0.3)  # let it get under way

    def ended(self) -> tuple[int, str]:
        """Exit status and log."""
        _, log = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, log


def contactd(*arguments: object, **options: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "programs.contactd.contactd", *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, text=True, **options)  # type: ignore[call-overload]


def run(simulator: Simulator, door: Path) -> subprocess.Popen[str]:
    arguments = (simulator.robot, "--port", simulator.port, "--socket", door)
    # A black box of its own: the owner's are kept by number.
    environment = os.environ | {"XDG_STATE_HOME": str(door.parent)}
    return contactd("run", *arguments, stderr=subprocess.PIPE, env=environment)


@contextmanager
def gone_afterwards(process: subprocess.Popen[str]) -> Iterator[subprocess.Popen[str]]:
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def listen(simulator: Simulator) -> None:
    assert simulator.process.stdout is not None
    for line in simulator.process.stdout:
        event = json.loads(line)
        if event.get("kind") == "drive":
            simulator.reported.append(event["text"])


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Romeo with a small trajectory, which fits wherever the one before was cut off."""
    folder = tmp_path_factory.mktemp("robot") / "romeo"
    shutil.copytree(ROMEO, folder)
    config = folder / "config.yaml"
    text, changed = re.subn(
        r"(LShoulderPitch: \{amplitude): [\d.]+", r"\1: 0.08", config.read_text()
    )
    assert changed == 1
    config.write_text(text)
    return folder


@pytest.fixture(scope="module")
def simulator(robot: Path) -> Iterator[Simulator]:
    with simulated(robot) as simulator:
        yield simulator


@contextmanager
def simulated(robot: Path) -> Iterator[Simulator]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = contactd("simulate", robot, "--port", port, stdout=subprocess.PIPE)
    with gone_afterwards(command) as process:
        assert process.stdout is not None
        assert "listening" in process.stdout.readline()
        simulator = Simulator(process, port, robot)
        reader = threading.Thread(target=listen, args=(simulator,))
        reader.start()
        yield simulator
        process.kill()
        reader.join(TIMEOUT_S)


@pytest.fixture
def daemon(simulator: Simulator, tmp_path: Path) -> Iterator[Daemon]:
    """Off, with samples."""
    with gone_afterwards(run(simulator, tmp_path / "door")) as process:
        daemon = Daemon(process, tmp_path / "door")
        daemon.becomes("off")
        simulator.reported.clear()
        yield daemon


def all_stopped(simulator: Simulator) -> None:
    for did in ("heartbeat of the master lost, quick stop", "standing, holding"):
        eventually(
            lambda did=did: simulator.drives_that(did) == 7,  # type: ignore[misc]
            lambda did=did: f"{did}: {simulator.drives_that(did)} of 7",  # type: ignore[misc]
        )


def test_killed_while_moving(simulator: Simulator, daemon: Daemon) -> None:
    daemon.moves()
    daemon.process.kill()
    all_stopped(simulator)


def test_twice_then_stopped_then_terminated_while_moving(
    simulator: Simulator, daemon: Daemon, tmp_path: Path
) -> None:
    daemon.moves()
    # A second daemon, at the same door, and at another.
    with (
        gone_afterwards(run(simulator, daemon.door)) as second,
        gone_afterwards(run(simulator, tmp_path / "other")) as third,
    ):
        _, said = second.communicate(timeout=TIMEOUT_S)
        assert second.returncode == 1
        assert f"another contactd (pid {daemon.process.pid}) serves" in said
        _, said = third.communicate(timeout=TIMEOUT_S)
        assert third.returncode == 69
        assert re.search(r"another master .*is on this bus", said)  # its heartbeat, or its SYNC
    assert daemon.mode() == "tracking", "the first one does not mind"

    # Stopped for longer than the drives wait.
    os.kill(daemon.process.pid, signal.SIGSTOP)
    all_stopped(simulator)
    time.sleep(0.1)  # the last heartbeat was a little before it was stopped
    os.kill(daemon.process.pid, signal.SIGCONT)
    daemon.becomes("faulted")
    assert "a fault is latched" in daemon.ask("enable")[0]
    while reasons := daemon.ask("reset"):
        assert "not seen to stand yet" in reasons[0]
    daemon.becomes("off")
    simulator.reported.clear()
    daemon.moves()

    # Asked to end while it moves.
    daemon.process.terminate()
    code, log = daemon.ended()
    assert code == 0, log
    assert "the daemon was absent" in log, log
    steps = ["tracking -> stopping", "stopping -> holding", "holding -> off", "ended: hold"]
    where = [log.rfind(step) for step in steps]
    assert -1 not in where, log
    assert where == sorted(where), "decelerate, stand, let every joint end as configured"
    assert simulator.drives_that("heartbeat of the master lost") == 0, "our leaving is no fault"


def off(daemon: Daemon) -> bool:
    """True if it is; a busy machine may have latched a fault, which is reset."""
    if daemon.mode() == "faulted":
        daemon.ask("reset")
    return daemon.mode() == "off"


def frames_mean(daemon: Daemon) -> str:
    """Configuration beside a log of the frames that the black box holds now."""
    log = daemon.door.parent / "now.log"
    program = contactd(
        "black-box", "--socket", daemon.door, "--output", log, stdout=subprocess.PIPE
    )
    said, _ = program.communicate(timeout=TIMEOUT_S)
    assert program.returncode == 0
    assert int(said.split()[0]) > 0
    (context,) = log.parent.glob("now*.json")
    return str(json.loads(context.read_text())["snapshot"]["configuration"])


def read_anew(daemon: Daemon) -> Status:
    eventually(lambda: off(daemon), daemon.mode)
    return reload(daemon.door)


def test_files_are_taken_up_in_the_same_process(daemon: Daemon, robot: Path) -> None:
    config = robot / "config.yaml"
    before = config.read_text()
    try:
        config.write_text(before.replace("quiet_s:", "quiet_s: 0.7  # "))
        found = read_anew(daemon)
        assert (found.pid, found.changed) == (daemon.process.pid, [])
        with Client(daemon.door) as client:
            assert "quiet_s: 0.7" in client.subscribe()[0].configuration
        assert "quiet_s: 0.7" in frames_mean(daemon)

        # What is bad is not taken up; nor is what the drives do not bear.
        config.write_text(before.replace("node: 1,", "node: 100,", 1))
        with pytest.raises(ControlError, match=r"not taken up: .*node 100"):
            read_anew(daemon)
        assert "not taken up" in daemon.ask("enable")[0]
        config.write_text("name: half")
        with pytest.raises(ControlError, match=r"not taken up: .*config\.yaml"):
            read_anew(daemon)
        config.write_text(before)
        assert read_anew(daemon).pid == daemon.process.pid
    finally:
        config.write_text(before)


def test_killed_while_it_reads_its_files_anew(simulator: Simulator, daemon: Daemon) -> None:
    with Client(daemon.door) as client:
        eventually(lambda: off(daemon) and client.request("reload").ok, daemon.mode)
        with suppress(UnreachableError):
            client.packet()  # it has ended its run, and begins anew
    daemon.process.kill()
    assert daemon.ended()[0] == -signal.SIGKILL
    with gone_afterwards(run(simulator, daemon.door)) as process:
        another = Daemon(process, daemon.door)
        another.becomes("off")


def test_asked_to_end_while_it_reads_its_files_anew(daemon: Daemon) -> None:
    with Client(daemon.door) as client:
        eventually(lambda: off(daemon) and client.request("reload").ok, daemon.mode)
    daemon.process.terminate()
    code, log = daemon.ended()
    assert code == 0, log


def test_its_bus_goes_away(simulator: Simulator, daemon: Daemon) -> None:
    simulator.process.kill()
    code, log = daemon.ended()
    assert code == 69, log
    assert "adapter gone: " in log
    assert "the drives stop by themselves" in log
