"""Simulated arm and daemon as two processes that talk CANopen over TCP, in real time."""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from common.errors import ContactdError
from daemon.protocol.state import Snapshot, State
from programs.clients.client import Client

TIMEOUT_S = 30.0


@dataclass(frozen=True, slots=True)
class Pair:
    """Both processes, and what they leave behind while the context lasts."""

    simulator: subprocess.Popen[bytes]
    daemon: subprocess.Popen[bytes]
    door: Path  # the control socket
    port: int  # of the simulated bus
    log: Path  # what the daemon says
    events: Path  # lines of JSON: what happens to the simulated arm

    def subscribed(self, timeout_s: float = 2.0) -> tuple[Client, Snapshot, Iterator[State]]:
        """A connection that gets every State, once the daemon serves; it may be silent for
        `timeout_s`. Raises ContactdError."""
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            try:
                client = Client(self.door, timeout_s)
                return client, *client.subscribe()
            except ContactdError:
                if time.monotonic() > deadline or self.daemon.poll() is not None:
                    raise
                time.sleep(0.1)


@contextlib.contextmanager
def pair(robot: Path, hand: Path | None = None) -> Iterator[Pair]:
    """Simulator and daemon of the robot's folder; `hand` is the script of a hand. At the end the
    daemon gets SIGTERM, and is killed if it does not end."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="contactd-pair-") as folder:
        place = Path(folder)
        door, log, events = place / "control", place / "log", place / "events"
        program = [sys.executable, "-m", "programs.contactd.contactd"]
        simulate = [*program, "simulate", str(robot), "--port", str(port)]
        simulate += ["--hand", str(hand)] if hand else []
        run = [*program, "run", str(robot), "--port", str(port), "--socket", str(door)]
        environment = {**os.environ, "XDG_STATE_HOME": str(place)}  # of the black box
        with (
            log.open("wb") as said,
            events.open("wb") as happened,
            subprocess.Popen(simulate, stdout=happened) as simulator,
        ):
            try:
                _wait_for(events, simulator)
                with subprocess.Popen(run, stderr=said, env=environment) as daemon:
                    try:
                        yield Pair(simulator, daemon, door, port, log, events)
                    finally:
                        daemon.terminate()
                        try:
                            daemon.wait(TIMEOUT_S)
                        except subprocess.TimeoutExpired:
                            daemon.kill()
            finally:
                simulator.kill()


def _wait_for(events: Path, simulator: subprocess.Popen[bytes]) -> None:
    """Wait for its first line, which announces that it listens."""
    deadline = time.monotonic() + TIMEOUT_S
    while not events.stat().st_size:
        if simulator.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError("the simulated arm does not start")
        time.sleep(0.05)
