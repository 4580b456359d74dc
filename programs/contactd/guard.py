"""`contactd guard`: process of the guardian, which shares only the bus with the daemon."""

import logging
import os
import signal
import time
from contextlib import ExitStack, closing
from pathlib import Path
from types import FrameType
from typing import Final

from common.errors import BusError
from daemon.config.load import Robot, load_robot
from daemon.drives import open_wire
from daemon.service.journal import log_to_stderr
from daemon.service.notify import Notifier, notifier_of
from daemon.service.realtime import go_realtime
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Wire
from drivers.makes import guardian_of
from drivers.motors.guardian import Activity, Guardian
from programs.command_line.sentences import say

_log = logging.getLogger("contactd")

#: Timeout of receiving a frame [s]: well below the silence after which the guardian takes over.
TURN_S: Final = 0.002
#: Delay before a bus that has failed is opened again [s].
AGAIN_S: Final = 0.5
#: Longest time to lower an arm that it holds before the process ends [s].
LOWERS_S: Final = 25.0

WORDS: Final = {
    Activity.WATCHES: "watching",
    Activity.HOLDS: "the daemon is silent: holding the arm",
    Activity.LOWERS: "lowering the arm",
}


def run_guard(config: Path, port: int | None) -> None:
    """Guard the arm of a configuration until SIGTERM or SIGINT. Raises ContactdError."""
    robot = load_robot(config).with_port(port)
    c = robot.configuration
    if (guardian := guardian_of(c.joint_drives)) is None:
        say(f"{robot.path}: its drives stop and hold by themselves: no guardian is needed")
        return
    with log_to_stderr(), closing(notifier_of(os.environ, os.getpid())) as notifier:
        _Guard(robot, guardian, notifier).run()


class _Guard:
    """Single-threaded loop of the process, ended by a signal."""

    def __init__(self, robot: Robot, guardian: Guardian, notifier: Notifier) -> None:
        self._robot, self._guardian, self._notifier = robot, guardian, notifier
        self._end_by_s: float | None = None
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self._guardian.lowers = True
        self._end_by_s = self._end_by_s or time.monotonic() + LOWERS_S

    @property
    def _ended(self) -> bool:
        if self._end_by_s is None:
            return False
        holds = self._guardian.activity is not Activity.WATCHES and not self._guardian.unloaded
        return not holds or time.monotonic() > self._end_by_s

    def run(self) -> None:
        """Guard, and reopen the bus after a failure. Raises BusError if the bus cannot be opened at
        the start."""
        ready = False
        while not self._ended:
            with ExitStack() as opened:
                try:
                    wire = open_wire(self._robot, opened)
                    if not ready:
                        grants = go_realtime()
                        _log.info(", ".join(grant.text for grant in grants[:2]))
                        self._notifier.ready("watching")
                        _log.info(WORDS[Activity.WATCHES])
                        ready = True
                    self._serve(wire)
                except (BusError, *BUS_FAILURES) as error:
                    if not ready:
                        raise
                    _log.error("the bus failed: %s", error)
                    time.sleep(AGAIN_S)

    def _serve(self, wire: Wire) -> None:
        guardian, activity = self._guardian, self._guardian.activity
        while not self._ended:
            frame = wire.receive(TURN_S)
            now = time.monotonic()
            if frame is not None:
                guardian.take(now, *frame)
            if frames := guardian.step(now):
                wire.send(frames)
            if guardian.activity is not activity:
                activity = guardian.activity
                _log.warning(WORDS[activity])
                self._notifier.status(WORDS[activity])
            self._notifier.ticked(now)
