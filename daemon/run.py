"""Life of `contactd run`: from a configuration to a ticking loop, and back to a safe end."""

import logging
import os
import signal
import time
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np

import compiled
from contactd_client.paths import default_socket_path
from daemon.assembly import build_boot, build_estimator, build_tick, check_identification
from daemon.config.load import Robot
from daemon.ending import bring_to_rest, stop_on_error
from daemon.modes.table import Mode
from daemon.protocol.messages import Grant
from daemon.service.black_box import BlackBox, default_directory, ring_path
from daemon.service.journal import log_to_stderr
from daemon.service.notify import Notifier, notifier_of
from daemon.service.realtime import go_realtime
from daemon.service.service import Service
from daemon.service.socket import ControlSocket
from daemon.service.status import Process, context_of
from daemon.service.trend_line import TrendLine
from daemon.tick.loop import Clock, Loop
from daemon.trends.day import folder_of
from drivers.can.bus import open_bus
from drivers.can.bus_load import frame_rate_hz
from drivers.can.frame_ring import RecordedWire
from drivers.can.wire import OpenBus
from errors import BusError, DriveError

_log = logging.getLogger("contactd")


def run_daemon(robot: Robot, socket: Path | None) -> None:
    """Run until SIGTERM or SIGINT. Raises ContactdError if it cannot start or a drive does not
    end as it should."""
    with log_to_stderr():
        signals = _Signals()
        # The socket comes first: of two daemons for one arm only one gets as far as the bus.
        with (
            ControlSocket(socket or default_socket_path()) as control,
            closing(notifier_of(os.environ, os.getpid())) as notifier,
        ):
            bus = open_bus(robot.configuration.bus)
            try:
                # Both processes start before this one is real-time.
                with (
                    _black_box(robot, control) as black_box,
                    closing(TrendLine(robot, _trends_of(robot))) as trends,
                ):
                    _serve(robot, bus, control, notifier, signals, black_box, trends)
            finally:
                bus.python_can.shutdown()


def _serve(
    robot: Robot,
    bus: OpenBus,
    control: ControlSocket,
    notifier: Notifier,
    signals: "_Signals",
    black_box: BlackBox,
    trends: TrendLine,
) -> None:
    c = robot.configuration
    boot = build_boot(robot, bus.wire, black_box.ring)

    def progress(line: str) -> None:
        _log.info(line)
        notifier.status(f"starting: {line}")

    boot.boot_up(progress)
    if signals.received:
        return
    serials = [identity.serial for identity in boot.identities]
    identification = check_identification(robot, serials)
    ring = black_box.ring
    wire = RecordedWire(bus.wire, ring) if ring else bus.wire
    tick = build_tick(robot, wire, time.monotonic, identification)
    _warm_up(robot)
    if not_compiled := compiled.warning():
        _log.warning(not_compiled)
    plain = bool(not_compiled)
    words = "runs as plain Python, a tick takes far longer" if plain else "compiled"
    realtime = [*go_realtime(), Grant("compiled", not plain, words)]
    for grant in realtime:
        _log.log(logging.INFO if grant.achieved else logging.WARNING, "real time: %s", grant.text)
    process = Process(robot, os.getpid(), realtime, serials)
    loop = Loop(tick, Clock(time.monotonic, sleep_until, time.time), c.period_s)
    service = Service(process, loop, control, notifier, boot, black_box, trends)
    # From the first heartbeat on the drives expect the next.
    tick.drives.start(0.0)
    _log.info("%s: ready, off, at %s", c.name, control.path)
    notifier.ready(service.summary())
    black_box.begin()
    with stop_on_error(tick.drives, c.period_s):
        loop.run(service.doors, lambda: not (signals.received or tick.fatal))
        why = signals.received or str(tick.fatal)
        service.ending = True
        notifier.stopping(f"stopping: {why}")
        stragglers = (
            []
            if tick.fatal
            else bring_to_rest(loop, service.doors, c.supervisor.stop_timeout_s, why)
        )
    if tick.fatal:
        raise BusError(f"{tick.fatal}; the drives stop by themselves")
    if not stragglers and tick.controller.machine.mode is Mode.OFF:
        # At rest for good, the drives need not miss us.
        boot.let_go()
    tick.drives.end()
    if stragglers:
        raise DriveError(f"these drives did not end as configured: {', '.join(stragglers)}")
    _log.info("ended: %s", _ending(robot))


def _black_box(robot: Robot, control: ControlSocket) -> BlackBox:
    c = robot.configuration
    rate_hz = frame_rate_hz(c.joint_drives, c.period_s)
    snapshot = msgspec.json.encode(context_of(robot))
    return BlackBox(ring_path(control.path), default_directory(), rate_hz, snapshot)


def _trends_of(robot: Robot) -> Path:
    return folder_of(default_directory(), robot.configuration.name)


def _warm_up(robot: Robot) -> None:
    """Let an estimator of the same kind take a few steps: the first ones load code and touch memory
    for tens of milliseconds, which the first ticks do not have."""
    estimator = build_estimator(robot.configuration, robot.urdf)
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
    """Name of the first SIGTERM or SIGINT; a second SIGINT during the end changes nothing, for
    the arm must be brought to rest."""

    def __init__(self) -> None:
        self.received = ""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._receive)

    def _receive(self, number: int, _: object) -> None:
        self.received = self.received or signal.Signals(number).name
