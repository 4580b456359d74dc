"""The whole daemon behind its socket, in lockstep with the simulated arm, as clients meet it."""

import fcntl
import math
import select
import socket
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from unittest import mock

from click import Command
from click.testing import CliRunner, Result

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from common.errors import ContactdError
from contactd_client.connection import Connection
from daemon.assembly import check_identification
from daemon.config.files import Files
from daemon.config.load import load_robot
from daemon.protocol.replies import Reply
from daemon.protocol.state import State
from daemon.service.notify import Notifier
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.tick.loop import Loop
from drivers.canopen.boot.sdo import ObjectAccess
from programs.clients.client import Client
from programs.contactctl import contactctl
from programs.contactd import contactd

_TIMEOUT_S = 5.0


class PatientSocket(ControlSocket):
    """Control socket that waits for its readers: in lockstep a tick may take as long as it likes,
    and must not be lost because this clock is faster than they are."""

    def publish(self, state: State) -> None:
        """Publish as usual, once every reader has room, and took what was published before; or
        after READING_S of waiting: it may be asking something meanwhile."""
        patient_until = time.monotonic() + READING_S
        for connection in self.readers:
            while unread(connection.socket) and time.monotonic() < patient_until:
                time.sleep(1e-5)
            select.select([], [connection.socket], [], _TIMEOUT_S)
        super().publish(state)


class PatientConnection(Connection):
    """A client's connection that waits for the answer as long as a busy machine takes for it."""

    asked_s = 0.0  # when one of them last asked, by this machine's clock

    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__(path, max(timeout_s, ANSWERED_S))

    def exchange(self, request: bytes, timeout_s: float) -> bytes:
        """As usual, but for the timeout."""
        PatientConnection.asked_s = time.monotonic()
        return super().exchange(request, max(timeout_s, ANSWERED_S))


class PatientAccess(ObjectAccess):
    """Objects of a simulated drive, waited for as long as a busy machine takes to answer."""

    def __init__(self, network: Any, setup: Any, timeout_s: float, *more: Any) -> None:
        super().__init__(network, setup, max(timeout_s, ANSWERED_S), *more)


@contextmanager
def unhurried_drives() -> Iterator[None]:
    """Inside, no drive is too slow by this machine's clock: for where none is to be silent."""
    with (
        mock.patch("drivers.canopen.boot.boot_up.ObjectAccess", PatientAccess),
        mock.patch("drivers.canopen.boot.boot_up.STEP_TIMEOUTS", 600.0),
        mock.patch("programs.identify.session._SETTLE_S", 600.0),
    ):
        yield


ANSWERED_S = 300.0
ASKS_S = 0.2  # a client that waits for something asks more often
READING_S = 0.005
TYPING_S = 0.03  # some ticks: in the same one, a request may be older than the stop before it


def unread(connection: socket.socket) -> int:
    """Bytes that were sent through a connection and not received yet."""
    answer = fcntl.ioctl(connection.fileno(), termios.TIOCOUTQ, bytes(4))
    return int.from_bytes(answer, sys.byteorder)


@dataclass(slots=True)
class ServedDaemon:
    """Service, loop and simulated arm; time passes by `tick` alone, every `idle_s` while no client
    reads, or `computing_s` while none asks either, and as fast as it reads while one does."""

    rig: Rig
    service: Service
    idle_s: float = 0.0005
    computing_s: float = 0.0

    @property
    def path(self) -> Path:
        """Path of the control socket."""
        return self.service.control.path

    def tick(self) -> None:
        """Do one tick, and the doors after it."""
        self.rig.step()
        self.service.doors()
        if self.service.commands.reloading:
            self._take_up()

    def _take_up(self) -> None:
        """Begin anew by the files, or if they are bad by those before, as `contactd run` does."""
        robot, refused = self.rig.robot, ""
        try:
            robot = load_robot(robot.path)
        except ContactdError as error:
            refused = str(error)
        files = self.service.process.files if refused else Files.of(robot)
        self.service.control.drop_all()
        self.rig.take_up(robot)
        self.service = serve(self.rig, self.service.control, self.service.notifier, files, refused)

    def run(self, seconds: float) -> None:
        """Tick for so long."""
        for _ in range(round(seconds / self.rig.robot.configuration.period_s)):
            self.tick()

    def until(self, work: Callable[[], Any]) -> Any:
        """Tick while `work`, which talks to the daemon, runs in a thread of its own."""
        results: list[Any] = []
        errors: list[BaseException] = []

        def run() -> None:
            try:
                results.append(work())
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        while thread.is_alive():
            self.tick()
            asks = time.monotonic() < PatientConnection.asked_s + ASKS_S
            idle_s = self.idle_s if asks else max(self.idle_s, self.computing_s)
            thread.join(0.0 if self.service.control.readers else idle_s)
        if errors:
            raise errors[0]
        return results[0]

    def ask(self, client: Client, command: Any) -> Reply:
        """The daemon's reply."""
        reply = self.until(lambda: client.request(command))
        assert isinstance(reply, Reply)
        return reply

    def contactctl(self, *arguments: str) -> Result:
        """Run `contactctl` as a person would type it, so not at once after another command."""
        self.run(TYPING_S)
        return self._typed(contactctl.main, ["--socket", str(self.path), *arguments])

    def contactd(self, *arguments: str, answers: IO[bytes] | None = None) -> Result:
        """Run a command of `contactd` that talks to the daemon, as a person would type it, with
        `answers` to what it asks."""
        return self._typed(contactd.main, [*arguments, "--socket", str(self.path)], answers)

    def _typed(self, main: Command, words: list[str], answers: IO[bytes] | None = None) -> Result:
        result = self.until(
            lambda: CliRunner().invoke(main, words, answers, catch_exceptions=False)
        )
        assert isinstance(result, Result)
        return result


@contextmanager
def served_daemon(
    folder: Path, robot: Path = SINGLE_JOINT, **both_ends: Any
) -> Iterator[ServedDaemon]:
    """The daemon of `robot`, off, with its socket in `folder`; `both_ends` as of `lockstep_rig`."""
    with (
        lockstep_rig(robot, identification=check_identification, **both_ends) as rig,
        PatientSocket(folder / "control") as control,
        closing(Notifier()) as notifier,
        mock.patch("programs.clients.client.Connection", PatientConnection),
    ):
        yield ServedDaemon(rig, serve(rig, control, notifier))


def serve(
    rig: Rig,
    control: ControlSocket,
    notifier: Notifier,
    files: Files | None = None,
    not_taken_up: str = "",
) -> Service:
    """The service around a rig's tick, off, with the first samples of its drives."""
    loop = Loop(rig.tick, rig.clock(), rig.robot.configuration.period_s)
    rig.run(0.1)
    process = Process(rig.robot, 1, [], rig.drives.serials, not_taken_up, files)
    service = Service(process, loop, rig.arming, control, notifier, rig.drives)
    service.commands.set_up.asking = rig.by_sdo
    # Here a second may pass while a client is not given a turn.
    service.commands.attendance.silent_s = math.inf
    return service
