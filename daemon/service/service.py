"""Running service: publishes each tick to readers and the log, and serves the control socket."""

import logging
from dataclasses import InitVar, dataclass, field

from daemon.arming.checks import ArmingChecks
from daemon.arming.permission import Permission
from daemon.modes.table import Mode
from daemon.protocol.socket_path import Peer
from daemon.protocol.text import printable
from daemon.service.black_box import BlackBox
from daemon.service.commands import Commands, outcome
from daemon.service.internal_errors import error_in_words, place_of
from daemon.service.journal import LogLimit
from daemon.service.notify import Notifier
from daemon.service.set_up import SetUp
from daemon.service.socket import ControlSocket
from daemon.service.status import Process
from daemon.service.trend_line import TrendLine
from daemon.tick.loop import Loop
from daemon.tick.telemetry import state_of
from drivers.api import BootableDrives

# Share of the period in a tick for admitting clients (one that waits outside may want to stop the
# arm), and share for beginning requests.
ENTRANCE_SHARE = 0.28
TURNS_SHARE = 0.1
SHOWN_BYTES = 200  # of a request that caused an error, in the log
LOOKS_EVERY = 100  # ticks between checks of the black box's helper
AT_REST = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})

_LEVELS = {"fault": logging.ERROR, "contact": logging.INFO, "mode": logging.INFO}
_log = logging.getLogger("contactd")


@dataclass(slots=True)
class Service:
    """Services around the loop, in the slack after each tick."""

    process: Process
    loop: Loop
    checks: InitVar[ArmingChecks]
    control: ControlSocket
    notifier: Notifier
    drives: InitVar[BootableDrives]
    black_box: BlackBox | None = None
    trends: TrendLine | None = None
    commands: Commands = field(init=False)
    _limit: LogLimit = field(default_factory=LogLimit)

    def __post_init__(self, checks: ArmingChecks, drives: BootableDrives) -> None:
        set_up = SetUp(
            drives,
            self.loop.tick,
            lambda: self.loop.time_s,
            lambda: self.notifier.ticked(self.loop.now_s),
            self.loop.resume,
        )
        permission = Permission(self.loop.tick, checks)
        parts = self.process, self.loop, self.control, permission
        self.commands = Commands(*parts, set_up, self.trends)
        self.control.answers.on_internal_error = self._on_internal_error

    def doors(self) -> None:
        """Publish the tick, log its events, serve the control socket: bounded work."""
        record = self.loop.tick.last
        if record is None:
            return
        if self.control.readers and record.decision is not None:
            self.control.publish(state_of(record, self.commands.permission.permit(record.time_s)))
        if self.trends is not None:
            self.trends.put(record, self.loop.tick.estimator)
        machine = self.loop.tick.controller.machine
        for notice in record.notices:
            if notice.kind == "fault" or self._limit.admit(notice.text, self.loop.time_s):
                self._report(notice.kind, notice.text)
            if notice.kind == "fault" and self.black_box is not None:
                self.black_box.report(notice.text)
            if notice.kind == "mode":
                self.notifier.status(self.summary())
        if left_out := self._limit.summary(self.loop.time_s):
            self._report("mode", left_out)
        # A new process may delay a tick: only while the arm is at rest and need not yield.
        due = self.loop.tick.number % LOOKS_EVERY == 0
        at_rest = machine.mode in AT_REST and not machine.armed
        if self.black_box is not None and due and at_rest:
            self.black_box.look_after(self.loop.time_s)
        # After the State, which reports decisions of its own tick: this belongs to the next one.
        self.commands.permission.expire(self.loop.time_s)
        self.control.spare = self.commands.permission.connection
        period_s = self.process.robot.configuration.period_s
        self.control.poll(self.commands.handle, TURNS_SHARE * period_s, ENTRANCE_SHARE * period_s)
        self.commands.abandon_unattended()
        if machine.mode is Mode.OFF:
            self.process.files.look_on()
        self.notifier.ticked(record.wakeup.monotonic_s)

    def _report(self, kind: str, text: str) -> None:
        place = {"kind": kind, "tick": self.loop.tick.number}
        _log.log(_LEVELS[kind], "%s", text, extra=place)

    def summary(self) -> str:
        """Mode and its cause, and while off the reason why newer files are not in use, in one
        line."""
        machine = self.loop.tick.controller.machine
        line = f"{outcome(machine)}: {machine.cause}"
        refused = self.process.not_taken_up if machine.mode is Mode.OFF else ""
        return f"{line}; not taken up: {refused}" if refused else line

    def _on_internal_error(self, packet: bytes, peer: Peer, error: Exception) -> None:
        """Log an error of the program in answering a request."""
        asked = printable(packet[:SHOWN_BYTES].decode(errors="replace"))
        text = f"{error_in_words(error)} at {place_of(error)}, answering uid {peer.uid}: {asked}"
        if self._limit.admit(text, self.loop.time_s):
            self._report("fault", text)
