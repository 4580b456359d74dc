"""Running service: answers requests, publishes each tick to readers and the log."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from msgspec.structs import replace

from daemon.config.motion import limits_of
from daemon.modes.table import Event, Mode, ModeMachine
from daemon.motion.path import Place
from daemon.protocol.lease import in_words
from daemon.protocol.messages import Reply, Request, Status
from daemon.protocol.socket_path import Peer
from daemon.service.arguments import misplaced
from daemon.service.attendance import Attendance
from daemon.service.black_box import BlackBox
from daemon.service.journal import LogLimit
from daemon.service.notify import Notifier
from daemon.service.permission import Answer, Permission, owner_of
from daemon.service.set_up import SetUp
from daemon.service.socket import ControlSocket
from daemon.service.status import Process, snapshot_of, status_of
from daemon.service.trend_line import TrendLine
from daemon.service.upload import TrajectoryUpload
from daemon.tick.felt import felt_now
from daemon.tick.loop import Loop
from daemon.tick.telemetry import state_of
from drivers.boot.boot_up import DriveBoot
from errors import ModelError, TrajectoryError

# Keyed so that mypy names a new command that `handle` forgets.
EVENT_OF_COMMAND: dict[
    Literal["enable", "start", "pause", "disarm", "stop", "disable", "reset"], Event
] = {
    "enable": Event.ENABLE,
    "start": Event.START,
    "pause": Event.PAUSE,
    "disarm": Event.DISARM,
    "stop": Event.STOP,
    "disable": Event.DISABLE,
    "reset": Event.RESET,
}
# What the daemon still does for anybody once it is on its way out: nothing that moves or energises.
AT_THE_END = frozenset({"status", "subscribe", "disarm", "stop", "disable"})
# What may tell the drives to stop, or must wait until they stand: the answer says which are not
# seen to.
SEEN_TO_STAND = frozenset({"disarm", "stop", "disable", "reset"})
# Shares of the period after which, in a tick, nobody more is let in (who waits outside may want to
# stop the arm), and after which no more requests are begun.
ENTRANCE_SHARE = 0.28
TURNS_SHARE = 0.1
LOOKS_EVERY = 100  # ticks, after the black box's helper
AT_REST = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})

_TO_OFF = dict.fromkeys(Mode, "`contactctl disable` first") | {
    Mode.FAULTED: "`contactctl reset` first"
}
_LEVELS = {"fault": logging.ERROR, "contact": logging.INFO, "mode": logging.INFO}
_log = logging.getLogger("contactd")


def _outcome(machine: ModeMachine) -> str:
    return f"{machine.mode}, {'armed' if machine.armed else 'not armed'}"


@dataclass(slots=True)
class Service:
    """Everything around the loop, in the slack after each tick."""

    process: Process
    loop: Loop
    control: ControlSocket
    notifier: Notifier
    boot: DriveBoot
    black_box: BlackBox | None = None
    trends: TrendLine | None = None
    ending: bool = False  # the arm is being brought to rest for good, or to run by newer files
    reloading: bool = False  # somebody asked for that
    dock: TrajectoryUpload = field(init=False)
    permission: Permission = field(init=False)
    set_up: SetUp = field(init=False)
    attendance: Attendance = field(default_factory=Attendance)
    _limit: LogLimit = field(default_factory=LogLimit)

    def __post_init__(self) -> None:
        c = self.process.robot.configuration
        self.dock = TrajectoryUpload(c.joint_names, limits_of(c), c.trajectory.ramp_s)
        self.permission = Permission(self.loop.tick)
        self.set_up = SetUp(
            self.boot,
            self.loop.tick,
            lambda: self.loop.time_s,
            lambda: self.notifier.ticked(self.loop.now_s),
            self.loop.resume,
        )
        self.control.on_close = self._on_close

    # --- after every tick -------------------------------------------------------------------

    def doors(self) -> None:
        """Publish the tick, log its events, serve the control socket: bounded work."""
        record = self.loop.tick.last
        if record is None:
            return
        if self.control.readers and record.decision is not None:
            self.control.publish(state_of(record, self.permission.permit(record.time_s)))
        if self.trends is not None:
            self.trends.put(record, self.loop.tick.estimator)
        for notice in record.notices:
            if notice.kind == "fault" or self._limit.admit(notice.text, self.loop.time_s):
                self._tell(notice.kind, notice.text)
            if notice.kind == "fault" and self.black_box is not None:
                self.black_box.tell(notice.text)
            if notice.kind == "mode":
                self.notifier.status(self.summary())
        if left_out := self._limit.summary(self.loop.time_s):
            self._tell("mode", left_out)
        # A new process may cost a tick: none that moves the arm, or in which it may have to yield.
        due = self.loop.tick.number % LOOKS_EVERY == 0
        if self.black_box is not None and due and self._at_rest:
            self.black_box.look_after(self.loop.time_s)
        # After the State, which tells of what was decided in its tick: the next one tells of this.
        self.permission.expire(self.loop.time_s)
        period_s = self.process.robot.configuration.period_s
        self.control.poll(self.handle, TURNS_SHARE * period_s, ENTRANCE_SHARE * period_s)
        self._halt_unattended()
        self.notifier.ticked(record.wakeup.monotonic_s)

    @property
    def _at_rest(self) -> bool:
        machine = self.loop.tick.controller.machine
        return machine.mode in AT_REST and not machine.armed

    def _tell(self, kind: str, text: str) -> None:
        place = {"kind": kind, "tick": self.loop.tick.number}
        _log.log(_LEVELS[kind], "%s", text, extra=place)

    def summary(self) -> str:
        """Mode and its cause, and while off why newer files are not taken up, in one line."""
        machine = self.loop.tick.controller.machine
        said = f"{_outcome(machine)}: {machine.cause}"
        refused = self.process.not_taken_up if machine.mode is Mode.OFF else ""
        return f"{said}; not taken up: {refused}" if refused else said

    def handle(self, request: Request, peer: Peer) -> Reply:
        """Carry out one request; a refusal gives every reason."""
        if strange := misplaced(request):
            return self._reply(request, strange)
        if (self.ending or self.reloading) and request.command not in AT_THE_END:
            why = "reads its files anew" if self.reloading else "is ending"
            return self._reply(request, [f"the daemon {why}"])
        who = str(owner_of(request, peer))
        self.attendance.heard(peer.connection, self.loop.time_s)
        match request.command:
            case "status":
                reply = replace(self._reply(request), status=self._status())
            case "subscribe":
                snapshot = snapshot_of(self.process.robot, self.loop.tick)
                reply = replace(self._reply(request), snapshot=snapshot)
            case "load":
                reply = self._load(request, peer)
            case "go":
                reply = self._go(request, peer, who)
            case "gain":
                reply = self._gain(request, who)
            case "payload":
                reply = self._payload(request, who)
            case "arm":
                reply = self._arm(request, peer)
            case "renew":
                reply = self._renew(request, peer)
            case "reload":
                reply = self._reload(request, who)
            case command:
                reply = self._request(EVENT_OF_COMMAND[command], request, peer, who)
        return reply

    def _request(self, event: Event, request: Request, peer: Peer, who: str) -> Reply:
        if event is Event.ENABLE and (newer := self._newer()):
            return self._reply(request, newer)
        path = self.dock.take(peer.connection) if request.loaded else None
        reply = self._reply(request, self.set_up.request(event, who, path))
        if event is Event.START and reply.ok:
            self.attendance.begin(peer.connection if request.attended else 0, self.loop.time_s)
            reply = replace(reply, warnings=self._beyond_what_was_seen())
        return reply

    def _reply(self, request: Request, reasons: Sequence[str] = (), done: str = "") -> Reply:
        """Refusal for these reasons; without any, what was done: in words, or as the mode says."""
        machine = self.loop.tick.controller.machine
        outcome = "refused" if reasons else done or _outcome(machine)
        return Reply(
            ok=not reasons,
            message=f"{request.command}: {outcome}",
            reasons=list(reasons),
            mode=machine.mode,
            armed=machine.armed,
            unproved=list(self.loop.tick.unproved()) if request.command in SEEN_TO_STAND else [],
        )

    def _beyond_what_was_seen(self) -> list[str]:
        """Warnings about the path that was started; also in the log."""
        last, place = self.loop.tick.last, self.loop.tick.controller.motion.follower.place
        if last is None or place.path.motors_only:
            return []
        c = self.process.robot.configuration
        q = last.samples.link_position
        warnings = self.process.seen.beyond(c.joint_names, q, place)
        for text in warnings:
            _log.warning("start: %s", text)
        return warnings

    def _go(self, request: Request, peer: Peer, who: str) -> Reply:
        last, poses = self.loop.tick.last, self.process.poses
        if last is None or last.decision is None:
            return self._reply(request, ["no samples of the drives yet"])
        q = last.samples.link_position
        try:
            path = poses.path(request, q)
        except TrajectoryError as error:
            return self._reply(request, [str(error)])
        reasons = self.loop.tick.arming_checks.unsettled()
        if request.plan:
            reasons = reasons or self.loop.tick.controller.refusals(Event.START, path)
            seen = self.process.seen.beyond(poses.joints, q, Place(path))
            planned = self._reply(request, reasons, "planned")
            warnings = [*seen, *poses.short_of(path)]
            return planned if reasons else replace(planned, way=poses.way(path), warnings=warnings)
        reply = self._reply(request, reasons or self.set_up.request(Event.START, who, path))
        if not reply.ok:
            return reply
        self.attendance.begin(peer.connection if request.attended else 0, self.loop.time_s)
        warnings = [*self._beyond_what_was_seen(), *poses.short_of(path)]
        return replace(reply, way=poses.way(path), warnings=warnings)

    def _arm(self, request: Request, peer: Peer) -> Reply:
        answer = self.permission.arm(request, peer, self.loop.time_s)
        self.control.spare = self.permission.connection
        felt = None if answer.reasons else felt_now(self.loop.tick)
        return replace(self._granted(request, answer), checks=list(answer.checks), felt=felt)

    def _renew(self, request: Request, peer: Peer) -> Reply:
        return self._granted(request, self.permission.renew(request, peer, self.loop.time_s))

    def _granted(self, request: Request, answer: Answer) -> Reply:
        outcome = _outcome(self.loop.tick.controller.machine)
        done = f"{outcome} for {in_words(answer.duration_s)}"
        return self._reply(request, answer.reasons, done)

    def _on_close(self, peer: Peer) -> None:
        self.dock.release(peer.connection)
        self.permission.expire(self.loop.time_s, peer.connection)
        self._halt_unattended(peer.connection)

    def _halt_unattended(self, closed: int = 0) -> None:
        """Pause a way whose client watches it no more; `start` goes on with it."""
        if why := self.attendance.lost(self.loop.time_s, closed):
            controller, now = self.loop.tick.controller, self.loop.time_s
            controller.request(Event.PAUSE, f"the daemon: {why}", now)

    def _reload(self, request: Request, who: str) -> Reply:
        """Have whoever runs the loop end it, and begin anew by the files as they are."""
        mode = self.loop.tick.controller.machine.mode
        if mode is not Mode.OFF:
            return self._reply(request, [f"the drives must be off, not {mode}: {_TO_OFF[mode]}"])
        self.reloading = True
        changed = ", ".join(self.process.files.changed()) or "nothing"
        _log.info("reload: asked for by %s; changed: %s", who, changed)
        return self._reply(request, done="the files are read, and the drives set up anew")

    def _newer(self) -> list[str]:
        # No tick waits for files while the drives are on.
        off = self.loop.tick.controller.machine.mode is Mode.OFF
        return self.process.newer() if off else []

    def _status(self) -> Status:
        self._newer()
        permit = self.permission.permit(self.loop.time_s)
        status = status_of(
            self.process, self.loop, self.boot.identities, permit, len(self.control.readers)
        )
        return replace(status, gears=self.trends.warnings) if self.trends else status

    def _load(self, request: Request, peer: Peer) -> Reply:
        try:
            if request.header is not None:
                self.dock.begin(request.header, peer.connection)
            if request.rows is not None:
                self.dock.append(request.rows, peer.connection)
        except TrajectoryError as error:
            return replace(self._reply(request, [str(error)]), row=error.row)
        return self._reply(request)

    def _payload(self, request: Request, who: str) -> Reply:
        try:
            payload = self.process.payloads.asked_for(request)
        except ModelError as error:
            return self._reply(request, [str(error)])
        reasons = self.process.payloads.too_heavy(payload) or self.loop.tick.carry(payload, who)
        return self._reply(request, reasons, str(payload) if payload else "none")

    def _gain(self, request: Request, who: str) -> Reply:
        joint, gain = request.joint, request.gain
        if joint is None or gain is None:
            return self._reply(request, ["it takes a `joint` and a `gain`"])
        reasons = self.loop.tick.controller.set_gain(joint, gain, who)
        return self._reply(request, reasons, f"{joint} {gain:g} rad/s per Nm")
