"""Life cycle of `contactd run`: from a configuration to the running loop, and to a safe end."""

import logging
import os
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from common import compiled
from common.errors import BusError, ContactdError, DriveError
from contactd_client.paths import default_socket_path
from daemon.assembly import build_arming_checks, build_estimator, build_tick, check_identification
from daemon.config.files import Files
from daemon.config.load import Robot
from daemon.drives import Setups, build_drives, build_setups, frames_per_second, open_wire
from daemon.modes.table import Mode
from daemon.protocol.replies import Grant
from daemon.protocol.trend_row import trends_folder
from daemon.service.black_box import BlackBox, default_directory, ring_path
from daemon.service.journal import log_to_stderr
from daemon.service.notify import Notifier, notifier_of
from daemon.service.realtime import go_realtime, leave_realtime
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process, context_of
from daemon.service.trend_line import TrendLine
from daemon.shutdown import bring_to_rest, stop_on_error
from daemon.tick.loop import Clock, Loop
from daemon.tick.tick import Tick
from drivers.api import BootableDrives

_log = logging.getLogger("contactd")


@dataclass(frozen=True, slots=True)
class Basis:
    """Basis of one run of the daemon: a robot as loaded from its files, and the set-up of its
    drives. `not_taken_up` is the reason why newer files are not in use."""

    robot: Robot
    setups: Setups
    files: Files
    not_taken_up: str = ""


ReadRobot = Callable[[], Robot]


def read_basis(read: ReadRobot) -> Basis:
    """Basis from the present files. Raises ContactdError."""
    robot = read()
    return Basis(robot, build_setups(robot), Files.of(robot))


@dataclass(frozen=True, slots=True)
class _Arm:
    """One arm with drives that are set up, ready for the loop."""

    basis: Basis
    drives: BootableDrives
    tick: Tick
    loop: Loop
    service: Service
    black_box: BlackBox


def run_daemon(read: ReadRobot, socket: Path | None) -> None:
    """Run until SIGTERM or SIGINT. At a `reload`, end in the same way and start again with the
    files that `read` then finds, in the same process and at the same socket.

    If these cannot be read or set up, the daemon continues with the previous ones, in mode off.
    Raises ContactdError if it cannot start or a drive does not end as configured.
    """
    basis = read_basis(read)
    with log_to_stderr():
        signals = _Signals()
        # The socket comes first: of two daemons for one arm only one reaches the bus.
        with (
            ControlSocket(socket or default_socket_path()) as control,
            closing(notifier_of(os.environ, os.getpid())) as notifier,
        ):
            before: Basis | None = None
            while True:
                with ExitStack() as opened:
                    try:
                        arm = _set_up(basis, opened, control, notifier)
                    except ContactdError as error:
                        if before is None or signals.received:
                            raise
                        basis, before = _not_taken_up(before, error), None
                        continue
                    if not _serve(arm, control, notifier, signals):
                        return
                before, basis = _reload(basis, read)


def _reload(basis: Basis, read: ReadRobot) -> tuple[Basis | None, Basis]:
    """Basis to fall back to (None if it is the same), and basis of the next run."""
    leave_realtime()
    try:
        return replace(basis, not_taken_up=""), read_basis(read)
    except ContactdError as error:
        return None, _not_taken_up(basis, error)


def _not_taken_up(basis: Basis, error: ContactdError) -> Basis:
    _log.error("not taken up: %s", error)
    return replace(basis, not_taken_up=str(error))


def _set_up(basis: Basis, opened: ExitStack, control: ControlSocket, notifier: Notifier) -> _Arm:
    """Open the bus, set the drives up, and build everything; `opened` closes it."""
    robot, c = basis.robot, basis.robot.configuration
    wire = open_wire(robot, opened)
    # Both processes start before this one is real-time.
    black_box = opened.enter_context(_black_box(robot, control))
    trends = opened.enter_context(closing(TrendLine(robot, _trends_of(robot))))
    drives = build_drives(robot, wire, time.monotonic, black_box.ring, basis.setups)

    def progress(line: str) -> None:
        _log.info(line)
        notifier.status(f"starting: {line}")

    drives.boot_up(progress)
    serials = list(drives.serials)
    identification = check_identification(robot, serials)
    tick = build_tick(robot, drives, identification)
    checks = build_arming_checks(robot, tick, identification)
    _warm_up(robot)
    process = Process(robot, os.getpid(), _realtime(), serials, basis.not_taken_up, basis.files)
    loop = Loop(tick, Clock(time.monotonic, sleep_until, time.time), c.period_s)
    service = Service(process, loop, checks, control, notifier, drives, black_box, trends)
    return _Arm(basis, drives, tick, loop, service, black_box)


def _realtime() -> list[Grant]:
    """Real-time set-up of this process: each part, granted or not, which is logged."""
    not_compiled = compiled.warning()
    if not_compiled:
        _log.warning(not_compiled)
    words = "runs as plain Python, a tick takes far longer" if not_compiled else "compiled"
    realtime = [*go_realtime(), Grant("compiled", not not_compiled, words)]
    for grant in realtime:
        _log.log(logging.INFO if grant.achieved else logging.WARNING, "real time: %s", grant.text)
    return realtime


def _serve(arm: _Arm, control: ControlSocket, notifier: Notifier, signals: "_Signals") -> bool:
    """Run the loop to its end, and bring the arm to rest; True if the daemon is to start again."""
    robot, c = arm.basis.robot, arm.basis.robot.configuration
    tick, loop, service, commands = arm.tick, arm.loop, arm.service, arm.service.commands
    if signals.received:
        return False
    # From the first heartbeat on, the drives expect the next.
    arm.drives.start(0.0)
    _log.info("%s: ready, off, at %s", c.name, control.path)
    notifier.ready(service.summary())
    arm.black_box.begin()
    with stop_on_error(arm.drives, c.period_s):
        loop.run(service.doors, lambda: not (signals.received or tick.fatal or commands.reloading))
        why = signals.received or str(tick.fatal or "reload")
        commands.ending = True
        anew = commands.reloading and not (signals.received or tick.fatal)
        if anew:
            notifier.reloading("reading the files anew", loop.now_s)
        else:
            notifier.stopping(f"stopping: {why}")
        stragglers = (
            []
            if tick.fatal
            else bring_to_rest(loop, service.doors, c.supervisor.stop_timeout_s, why)
        )
    if tick.fatal:
        raise BusError(f"{tick.fatal}; the drives stop by themselves")
    if not stragglers and tick.controller.machine.mode is Mode.OFF:
        _release_drives(arm.drives, again=anew)
    arm.drives.end()
    if stragglers:
        raise DriveError(f"these drives did not end as configured: {', '.join(stragglers)}")
    _log.info("ended: %s", _ending(robot))
    control.drop_all()
    return anew and not signals.received


def _release_drives(drives: BootableDrives, *, again: bool) -> None:
    """Disable the drives' monitoring of our heartbeat, as the arm is at rest for good. A failure is
    only logged if they will be set up `again`, which tries it more than once."""
    try:
        drives.disable_monitoring()
    except DriveError as error:
        if not again:
            raise
        _log.warning("%s", error)


def _black_box(robot: Robot, control: ControlSocket) -> BlackBox:
    rate_hz = frames_per_second(robot.configuration)
    snapshot = msgspec.json.encode(context_of(robot))
    return BlackBox(ring_path(control.path), default_directory(), rate_hz, snapshot)


def _trends_of(robot: Robot) -> Path:
    return trends_folder(default_directory(), robot.configuration.name)


def _warm_up(robot: Robot) -> None:
    """Run a separate estimator of the same kind for a few steps: the first ones load code and touch
    memory for tens of milliseconds, more than the first ticks can spare. The tick's own estimator
    must begin without samples."""
    estimator = build_estimator(robot.configuration, robot.model)
    nothing = np.zeros(len(robot.configuration.joints))
    for _ in range(20):
        estimator.step(nothing, nothing, nothing, nothing)


def _ending(robot: Robot) -> str:
    ends: dict[str, list[str]] = {}
    for joint in robot.configuration.joints:
        ends.setdefault(joint.end, []).append(joint.name)
    return "; ".join(f"{end}: {', '.join(names)}" for end, names in ends.items())


def sleep_until(deadline: float) -> None:
    """Wait until CLOCK_MONOTONIC shows `deadline` [s]."""
    if (left := deadline - time.monotonic()) > 0.0:
        time.sleep(left)


class _Signals:
    """Name of the first SIGTERM or SIGINT; a second SIGINT while ending has no effect, as the arm
    must be brought to rest."""

    def __init__(self) -> None:
        self.received = ""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._receive)

    def _receive(self, number: int, _: object) -> None:
        self.received = self.received or signal.Signals(number).name
