"""Running service: answers requests, and publishes each tick to readers and the log."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from common.errors import ModelError, TrajectoryError
from daemon.config.vectors import limits_of, stream_settings_of
from daemon.modes.machine import ModeMachine
from daemon.modes.table import Event, Mode
from daemon.motion.path import Place
from daemon.protocol import requests
from daemon.protocol.lease import in_words
from daemon.protocol.replies import Reply, Status
from daemon.protocol.requests import Request
from daemon.protocol.socket_path import Peer
from daemon.protocol.text import printable
from daemon.service.attendance import Attendance
from daemon.service.black_box import BlackBox
from daemon.service.journal import LogLimit
from daemon.service.mishaps import Checkpoint, error_in_words, place_of
from daemon.service.notify import Notifier
from daemon.service.permission import Answer, Permission, owner_of
from daemon.service.sensitivity import sensitivity_now
from daemon.service.set_up import SetUp
from daemon.service.socket import ControlSocket
from daemon.service.status import Process, snapshot_of, status_of
from daemon.service.streams import Streams
from daemon.service.trend_line import TrendLine
from daemon.service.upload import TrajectoryUpload
from daemon.tick.loop import Loop
from daemon.tick.telemetry import state_of
from drivers.api import BootableDrives

# Keyed so that mypy reports a new command that `_carry_out` omits.
EVENT_OF: dict[type[requests.ModeRequest], Event] = {
    requests.Enable: Event.ENABLE,
    requests.Pause: Event.PAUSE,
    requests.Disarm: Event.DISARM,
    requests.Stop: Event.STOP,
    requests.Disable: Event.DISABLE,
    requests.Reset: Event.RESET,
}
# Commands still served while the daemon is ending: none that moves or energises the arm.
AT_THE_END = frozenset({"status", "subscribe", "disarm", "stop", "disable"})
# Commands whose reply lists joints not confirmed at standstill.
SEEN_TO_STAND = frozenset({"disarm", "stop", "disable", "reset"})
# Share of the period in a tick for admitting clients (one that waits outside may want to stop the
# arm), and share for beginning requests.
ENTRANCE_SHARE = 0.28
TURNS_SHARE = 0.1
SHOWN_BYTES = 200  # of a request that broke, in the log
LOOKS_EVERY = 100  # ticks between checks of the black box's helper
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
    drives: BootableDrives
    black_box: BlackBox | None = None
    trends: TrendLine | None = None
    ending: bool = False  # the arm is being brought to rest for good, or for newer files
    reloading: bool = False  # the latter was requested
    upload: TrajectoryUpload = field(init=False)
    permission: Permission = field(init=False)
    set_up: SetUp = field(init=False)
    streams: Streams = field(init=False)
    attendance: Attendance = field(default_factory=Attendance)
    _limit: LogLimit = field(default_factory=LogLimit)

    def __post_init__(self) -> None:
        c = self.process.robot.configuration
        self.upload = TrajectoryUpload(c.joint_names, limits_of(c), c.trajectory.ramp_s)
        self.permission = Permission(self.loop.tick)
        self.streams = Streams(c.joint_names, limits_of(c), stream_settings_of(c))
        self.set_up = SetUp(
            self.drives,
            self.loop.tick,
            lambda: self.loop.time_s,
            lambda: self.notifier.ticked(self.loop.now_s),
            self.loop.resume,
        )
        self.control.on_close = self._on_close
        self.control.answers.on_mishap = self._on_mishap

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
        # After the State, which reports decisions of its own tick: this is in the next one.
        self.permission.expire(self.loop.time_s)
        period_s = self.process.robot.configuration.period_s
        self.control.poll(self.handle, TURNS_SHARE * period_s, ENTRANCE_SHARE * period_s)
        self._abandon_unattended()
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
        line = f"{_outcome(machine)}: {machine.cause}"
        refused = self.process.not_taken_up if machine.mode is Mode.OFF else ""
        return f"{line}; not taken up: {refused}" if refused else line

    def handle(self, request: Request, peer: Peer) -> Reply:
        """Carry out one request; a refusal lists every reason. After any exception the arm is as it
        was before, or stopped."""
        tick, permission = self.loop.tick, self.permission
        before = Checkpoint.of(tick, permission)
        try:
            return self._carry_out(request, peer)
        except Exception:
            before.go_back(request.command, tick, permission, self.loop.time_s)
            raise

    def _on_mishap(self, packet: bytes, peer: Peer, error: Exception) -> None:
        """Log an error of the program in answering a request."""
        asked = printable(packet[:SHOWN_BYTES].decode(errors="replace"))
        text = f"{error_in_words(error)} at {place_of(error)}, answering uid {peer.uid}: {asked}"
        if self._limit.admit(text, self.loop.time_s):
            self._report("fault", text)

    def _carry_out(  # noqa: PLR0912 - a case for each command
        self, request: Request, peer: Peer
    ) -> Reply:
        if refused := self._at_the_end(request):
            return self._reply(request, refused)
        who = str(owner_of(request, peer))
        self.attendance.heard(peer.connection, self.loop.time_s)
        match request:
            case requests.GetStatus():
                reply = replace(self._reply(request), status=self._status())
            case requests.Subscribe():
                snapshot = snapshot_of(self.process.robot, self.loop.tick)
                reply = replace(self._reply(request), snapshot=snapshot)
            case requests.Load():
                reply = self._load(request, peer)
            case requests.Go():
                reply = self._go(request, peer, who)
            case requests.Follow():
                reply = self._follow(request, peer, who)
            case requests.Target():
                reply = self._target(request, peer)
            case requests.SetGain():
                reply = self._gain(request, who)
            case requests.SetPayload():
                reply = self._payload(request, who)
            case requests.Arm():
                reply = self._arm(request, peer)
            case requests.Renew():
                reply = self._renew(request, peer)
            case requests.Reload():
                reply = self._reload(request, who)
            case requests.Start():
                reply = self._start(request, peer, who)
            case requests.Enable() if newer := self._newer():
                reply = self._reply(request, newer)
            case _:  # a ModeRequest
                event = EVENT_OF[type(request)]
                controller = self.loop.tick.controller
                ends = event is Event.PAUSE and self.streams.of(peer.connection, controller.stream)
                reply = self._reply(request, self.set_up.request(event, who))
                if ends and reply.ok:
                    # Its sender ends the stream; a pause by others holds the arm until `start`.
                    controller.request(Event.ABANDON, "the end of its stream", self.loop.time_s)
        return reply

    def _at_the_end(self, request: Request) -> list[str]:
        """Reasons why a request is not carried out any more."""
        if not (self.ending or self.reloading) or request.command in AT_THE_END:
            return []
        return [f"the daemon {'reads its files anew' if self.reloading else 'is ending'}"]

    def _start(self, request: requests.Start, peer: Peer, who: str) -> Reply:
        path = self.upload.take(peer.connection) if request.loaded else None
        controller = self.loop.tick.controller
        goes_on = path is None and controller.machine.paused
        warnings = self._beyond_what_was_seen(controller.next_place(path))
        reply = self._reply(request, self.set_up.request(Event.START, who, path))
        if not reply.ok:
            return reply
        self._set_out(request, peer, warnings, goes_on=goes_on)
        return replace(reply, warnings=warnings)

    def _set_out(
        self,
        request: requests.Start | requests.Go,
        peer: Peer,
        warnings: Sequence[str],
        *,
        goes_on: bool = False,
    ) -> None:
        # A continued motion stays with the client that began it.
        stays = goes_on and (not request.attended or self.loop.tick.controller.stream is not None)
        if not stays:
            self.attendance.begin(peer.connection if request.attended else 0, self.loop.time_s)
        for text in warnings:
            _log.warning("start: %s", text)

    def _reply(self, request: Request, reasons: Sequence[str] = (), done: str = "") -> Reply:
        """Refusal for these reasons; without any, the reply for `done`, or else for the mode."""
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

    def _beyond_what_was_seen(self, place: Place) -> list[str]:
        """Warnings about a path that is to be started."""
        last = self.loop.tick.last
        if last is None or last.decision is None or place.path.motors_only:
            return []
        c = self.process.robot.configuration
        return self.process.seen.beyond(c.joint_names, last.samples.link_position, place)

    def _go(self, request: requests.Go, peer: Peer, who: str) -> Reply:
        last, poses = self.loop.tick.last, self.process.poses
        if last is None or last.decision is None:
            return self._reply(request, ["no samples of the drives yet"])
        q = last.samples.link_position
        try:
            path = poses.path(request, q)
        except TrajectoryError as error:
            return self._reply(request, [str(error)])
        # All warnings, before the arm starts.
        seen, way = self._beyond_what_was_seen(Place(path)), poses.way(path)
        warnings = [*seen, *poses.short_of(path)]
        reasons = self.loop.tick.arming_checks.unsettled()
        if request.plan:
            reasons = reasons or self.loop.tick.controller.refusals(Event.START, path)
            reply = self._reply(request, reasons, "planned")
        else:
            reply = self._reply(request, reasons or self.set_up.request(Event.START, who, path))
            if reply.ok:
                self._set_out(request, peer, seen)
        return replace(reply, way=way, warnings=warnings) if reply.ok else reply

    def _follow(self, request: requests.Follow, peer: Peer, who: str) -> Reply:
        """Begin to follow a stream, or rejoin the one that this connection sends."""
        controller, last = self.loop.tick.controller, self.loop.tick.last
        if last is None or last.decision is None:
            return self._reply(request, ["no samples of the drives yet"])
        q, present = last.samples.link_position, controller.stream
        own = self.streams.of(peer.connection, present)
        if own and controller.machine.paused:
            why = f"the arm holds: {controller.machine.cause}; `contactctl start` goes on"
            return self._reply(request, [why])
        if own:
            target = self.streams.target(request)
            own.put(target)
            self.streams.refuse_far(target, q, begun=True)
            own.rejoin(interrupted=controller.machine.mode is not Mode.TRACKING)
            return self._followed(request)
        if present:
            return self._reply(request, [f"the arm follows {present.sender} already"])
        stream = self.streams.begun(request, q, who)
        reply = self._reply(request, self.set_up.request(Event.START, who, stream))
        if reply.ok:
            self.streams.own(stream, peer.connection)
            self.attendance.begin(peer.connection, self.loop.time_s)
        return replace(reply, stream=controller.stream_state())

    def _target(self, request: requests.Target, peer: Peer) -> Reply:
        controller = self.loop.tick.controller
        stream = self.streams.of(peer.connection, controller.stream)
        if stream is None:
            cause = self.streams.refusal(peer.connection, controller.machine.cause)
            return self._reply(request, [cause])
        stream.put(self.streams.target(request))
        return self._followed(request)

    def _followed(self, request: requests.Follow | requests.Target) -> Reply:
        """Reply to the sender of a stream that the arm follows."""
        self.streams.compare(self.process.seen)
        state = self.loop.tick.controller.stream_state()
        return replace(self._reply(request), stream=state, warnings=self.streams.warnings)

    def _arm(self, request: requests.Arm, peer: Peer) -> Reply:
        answer = self.permission.arm(request, peer, self.loop.time_s)
        self.control.spare = self.permission.connection
        sensitivity = None if answer.reasons else sensitivity_now(self.loop.tick)
        return replace(
            self._granted(request, answer), checks=list(answer.checks), sensitivity=sensitivity
        )

    def _renew(self, request: requests.Renew, peer: Peer) -> Reply:
        return self._granted(request, self.permission.renew(request, peer, self.loop.time_s))

    def _granted(self, request: requests.Arm | requests.Renew, answer: Answer) -> Reply:
        outcome = _outcome(self.loop.tick.controller.machine)
        done = f"{outcome} for {in_words(answer.duration_s)}"
        return self._reply(request, answer.reasons, done)

    def _on_close(self, peer: Peer) -> None:
        self.upload.release(peer.connection)
        self.permission.expire(self.loop.time_s, peer.connection)
        self._abandon_unattended(peer.connection)

    def _abandon_unattended(self, closed: int = 0) -> None:
        """Halt and forget a motion that its client no longer watches."""
        if why := self.attendance.lost(self.loop.time_s, closed):
            controller, now = self.loop.tick.controller, self.loop.time_s
            controller.request(Event.ABANDON, f"the daemon: {why}; its motion is forgotten", now)

    def _reload(self, request: requests.Reload, who: str) -> Reply:
        """Request the end of the loop, and a new start with the present files."""
        mode = self.loop.tick.controller.machine.mode
        if mode is not Mode.OFF:
            return self._reply(request, [f"the drives must be off, not {mode}: {_TO_OFF[mode]}"])
        changed = ", ".join(self.process.files.changed()) or "nothing"
        reply = self._reply(request, done="the files are read, and the drives set up anew")
        _log.info("reload: asked for by %s; changed: %s", who, changed)
        self.reloading = True
        return reply

    def _newer(self) -> list[str]:
        # Ticks do not wait for files while the drives are on.
        off = self.loop.tick.controller.machine.mode is Mode.OFF
        return self.process.newer() if off else []

    def _status(self) -> Status:
        self._newer()
        status = status_of(
            self.process,
            self.loop,
            self.drives.identities,
            self.permission.permit(self.loop.time_s),
            len(self.control.readers),
            attended=self.attendance.attended,
        )
        return replace(status, gears=self.trends.warnings) if self.trends else status

    def _load(self, request: requests.Load, peer: Peer) -> Reply:
        try:
            if request.header is not None:
                self.upload.begin(request.header, peer.connection)
            if request.rows is not None:
                self.upload.append(request.rows, peer.connection)
        except TrajectoryError as error:
            return replace(self._reply(request, [str(error)]), row=error.row)
        return self._reply(request)

    def _payload(self, request: requests.SetPayload, who: str) -> Reply:
        try:
            payload = self.process.payloads.asked_for(request)
        except ModelError as error:
            return self._reply(request, [str(error)])
        reasons = self.process.payloads.too_heavy(payload) or self.loop.tick.carry(payload, who)
        return self._reply(request, reasons, str(payload) if payload else "none")

    def _gain(self, request: requests.SetGain, who: str) -> Reply:
        reasons = self.loop.tick.controller.set_gain(request.joint, request.gain, who)
        return self._reply(request, reasons, f"{request.joint} {request.gain:g} rad/s per Nm")
