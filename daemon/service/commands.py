"""Commands of clients: their execution between two ticks, and their replies."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from common.errors import ModelError, TrajectoryError
from daemon.arming.permission import Answer, Permission, owner_of
from daemon.config.vectors import limits_of, stream_settings_of
from daemon.modes.machine import ModeMachine
from daemon.modes.table import Event, Mode
from daemon.motion.path import JointPath, PathPoint
from daemon.protocol import requests
from daemon.protocol.lease import in_words
from daemon.protocol.replies import Reply, Status
from daemon.protocol.requests import AT_THE_END, SEEN_TO_STAND, Request
from daemon.protocol.socket_path import Peer
from daemon.service.attendance import Attendance
from daemon.service.internal_errors import Checkpoint
from daemon.service.sensitivity import sensitivity_now
from daemon.service.set_up import SetUp
from daemon.service.socket import ControlSocket
from daemon.service.status import Process, snapshot_of, status_of
from daemon.service.streams import Streams
from daemon.service.trend_line import TrendLine
from daemon.service.upload import TrajectoryUpload
from daemon.tick.loop import Loop

_log = logging.getLogger("contactd")


def outcome(machine: ModeMachine) -> str:
    """Mode of the arm, and whether it is armed."""
    return f"{machine.mode}, {'armed' if machine.armed else 'not armed'}"


@dataclass(slots=True)
class Commands:
    """Commands to one arm, and their state: lease, trajectory, stream, attendance."""

    process: Process
    loop: Loop
    control: ControlSocket
    permission: Permission
    set_up: SetUp
    trends: TrendLine | None = None
    ending: bool = False  # the arm is being brought to rest, at the end or for a reload
    reloading: bool = False  # a reload was requested
    upload: TrajectoryUpload = field(init=False)
    streams: Streams = field(init=False)
    attendance: Attendance = field(default_factory=Attendance)

    def __post_init__(self) -> None:
        c = self.process.robot.configuration
        self.upload = TrajectoryUpload(c.joint_names, limits_of(c), c.trajectory.ramp_s)
        self.streams = Streams(c.joint_names, limits_of(c), stream_settings_of(c))
        self.control.on_close = self._on_close

    def handle(self, request: Request, peer: Peer) -> Reply:
        """Carry out one request; a refusal lists every reason. After an exception the arm is in its
        previous state, or stopped."""
        tick, permission = self.loop.tick, self.permission
        before = Checkpoint.of(tick, permission)
        try:
            return self._carry_out(request, peer)
        except Exception:
            before.go_back(request.command, tick, permission, self.loop.time_s)
            raise

    def _carry_out(self, request: Request, peer: Peer) -> Reply:  # noqa: PLR0912 - a case for each
        if (self.ending or self.reloading) and request.command not in AT_THE_END:
            why = "reads its files anew" if self.reloading else "is ending"
            return self._reply(request, [f"the daemon {why}"])
        who, now = str(owner_of(request, peer)), self.loop.time_s
        self.attendance.record_request(peer.connection, now)
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
            case requests.SetGain() | requests.SetGuide():
                reply = self._leading(request, who)
            case requests.SetPayload():
                reply = self._payload(request, who)
            case requests.Arm():
                reply = self._arm(request, peer)
            case requests.Renew():
                reply = self._granted(request, self.permission.renew(request, peer, now))
            case requests.Reload():
                reply = self._reload(request, who)
            case requests.Start():
                reply = self._start(request, peer, who)
            case _:  # a ModeRequest
                reply = self._change_mode(request, peer, who)
        return reply

    def _change_mode(self, request: requests.ModeRequest, peer: Peer, who: str) -> Reply:
        event, controller = Event(request.command), self.loop.tick.controller
        if event is Event.ENABLE and (newer := self._newer()):
            return self._reply(request, newer)
        ends = event is Event.PAUSE and self.streams.of(peer.connection, controller.stream)
        reply = self._reply(request, self.set_up.request(event, who))
        if ends and reply.ok:
            # A pause by its sender ends the stream; by others it holds the arm until `start`.
            controller.apply_event(Event.ABANDON, f"{who} ended its stream", self.loop.time_s)
        return reply

    def _start(self, request: requests.Start, peer: Peer, who: str) -> Reply:
        path = self.upload.take(peer.connection) if request.loaded else None
        seen = self._coverage_warnings(self.loop.tick.controller.next_place(path))
        reply = self._start_motion(request, peer, who, path, seen)
        return replace(reply, warnings=seen) if reply.ok else reply

    def _start_motion(
        self,
        request: requests.Start | requests.Go,
        peer: Peer,
        who: str,
        path: JointPath | None,
        seen: Sequence[str],
    ) -> Reply:
        """Start `path`, or the next motion if it is None."""
        controller = self.loop.tick.controller
        goes_on = path is None and controller.machine.paused
        reply = self._reply(request, self.set_up.request(Event.START, who, path))
        if reply.ok:
            # A continued motion stays with the client that began it.
            if not goes_on or (request.attended and controller.stream is None):
                self.attendance.begin(peer.connection if request.attended else 0, self.loop.time_s)
            for text in seen:
                _log.warning("start: %s", text)
        return reply

    def _reply(self, request: Request, reasons: Sequence[str] = (), done: str = "") -> Reply:
        """Refusal for these reasons; without any, a reply with the text `done`, or the mode."""
        machine = self.loop.tick.controller.machine
        done = "refused" if reasons else done or outcome(machine)
        return Reply(
            ok=not reasons,
            message=f"{request.command}: {done}",
            reasons=list(reasons),
            mode=machine.mode,
            armed=machine.armed,
            unproved=list(self.loop.tick.unproved()) if request.command in SEEN_TO_STAND else [],
        )

    def _coverage_warnings(self, place: PathPoint) -> list[str]:
        """Warnings about motion of a path that the thresholds do not cover."""
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
        seen, way = self._coverage_warnings(PathPoint(path)), poses.planned_path(path)
        warnings = [*seen, *poses.short_of(path)]
        reasons = self.permission.checks.unsettled()
        if request.plan:
            reasons = reasons or self.loop.tick.controller.refusals(Event.START, path)
        if request.plan or reasons:
            reply = self._reply(request, reasons, "planned")
        else:
            reply = self._start_motion(request, peer, who, path, seen)
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
            own.put(target)  # even if refused below: its sender is alive
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
        reply = self._granted(request, answer)
        return replace(reply, checks=list(answer.checks), sensitivity=sensitivity)

    def _granted(self, request: requests.Arm | requests.Renew, answer: Answer) -> Reply:
        done = f"{outcome(self.loop.tick.controller.machine)} for {in_words(answer.duration_s)}"
        return self._reply(request, answer.reasons, done)

    def _on_close(self, peer: Peer) -> None:
        self.upload.release(peer.connection)
        self.permission.expire(self.loop.time_s, peer.connection)
        self.abandon_unattended(peer.connection)

    def abandon_unattended(self, closed: int = 0) -> None:
        """Halt and forget a motion that its client no longer watches."""
        if why := self.attendance.lost(self.loop.time_s, closed):
            controller, now = self.loop.tick.controller, self.loop.time_s
            controller.request(Event.ABANDON, f"the daemon: {why}; its motion is forgotten", now)

    def _reload(self, request: requests.Reload, who: str) -> Reply:
        """Request the end of the loop, and a new start with the present files."""
        mode = self.loop.tick.controller.machine.mode
        if mode is not Mode.OFF:
            to_off = f"`contactctl {'reset' if mode is Mode.FAULTED else 'disable'}` first"
            return self._reply(request, [f"the drives must be off, not {mode}: {to_off}"])
        changed = ", ".join(self.process.files.changed()) or "nothing"
        reply = self._reply(request, done="the files are read, and the drives set up anew")
        _log.info("reload: requested by %s; changed: %s", who, changed)
        self.reloading = True
        return reply

    def _newer(self) -> list[str]:
        # Ticks do not wait for files while the drives are on.
        off = self.loop.tick.controller.machine.mode is Mode.OFF
        return self.process.newer() if off else []

    def _status(self) -> Status:
        self._newer()
        identities, readers = self.set_up.drives.identities, len(self.control.readers)
        parts, attended = (self.process, self.loop, self.permission), self.attendance.attended
        status = status_of(*parts, identities, readers, attended=attended)
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
        last, payloads = self.loop.tick.last, self.process.payloads
        try:
            payload = payloads.asked_for(request)
            walls = payloads.walls(payload, last.samples.link_position if last else None)
        except ModelError as error:
            return self._reply(request, [str(error)])
        reasons = payloads.too_heavy(payload) or self.loop.tick.carry(payload, who, walls)
        return self._reply(request, reasons, str(payload) if payload else "none")

    def _leading(self, request: requests.SetGain | requests.SetGuide, who: str) -> Reply:
        change = self.loop.tick.controller.leading.change
        return self._reply(request, *change(request, who))
