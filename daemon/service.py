"""The running service: answers requests, tells readers and the log, and ends in good order."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

import numpy as np

from daemon.config.load import Robot
from daemon.config.motion import limits_of
from daemon.control import ControlSocket
from daemon.cycle import DRIVE_STATE_NAMES, SIDE_NAMES, finite_list
from daemon.drives import Drives
from daemon.lease import PERSON_S, PROGRAM_S, Lease, Owner, in_words
from daemon.loading import LoadingDock
from daemon.loop import Loop
from daemon.messages import (
    Check,
    Grant,
    Permit,
    Reply,
    Request,
    Snapshot,
    Status,
    Trajectory,
)
from daemon.modes import Event, Mode, ModeMachine
from daemon.notify import Notifier
from daemon.peers import Peer
from drivers.cia402 import reached
from errors import ContactdError, ControlError, TrajectoryError

EVENT_OF_COMMAND = {
    "enable": Event.ENABLE,
    "start": Event.START,
    "pause": Event.PAUSE,
    "disarm": Event.DISARM,
    "stop": Event.STOP,
    "disable": Event.DISABLE,
    "reset": Event.RESET,
}
# How long the drives may take to reach the state they end in [s].
END_PATIENCE_S = 1.0

# Share of the period after which no more requests are begun in a tick.
DOORS_SHARE = 0.1

_LEVELS = {"fault": logging.ERROR, "contact": logging.INFO, "mode": logging.INFO}
_log = logging.getLogger("contactd")


def _misplaced(request: Request) -> list[str]:
    """What was said beside a command that takes no such thing."""
    takers = {
        "header": "load",
        "rows": "load",
        "loaded": "start",
        "lease_s": "arm",
        "detached": "arm",
        "joint": "gain",
        "gain": "gain",
    }
    return [
        f"`{field}` belongs to {command}"
        for field, command in takers.items()
        if getattr(request, field) not in (None, False) and request.command != command
    ]


def _outcome(machine: ModeMachine) -> str:
    return f"{machine.mode}, {'armed' if machine.armed else 'not armed'}"


@dataclass(slots=True)
class Service:
    """What stands around the loop, in the slack after each tick."""

    robot: Robot
    loop: Loop
    control: ControlSocket
    realtime: list[Grant]
    pid: int
    notifier: Notifier
    serials: list[int | None] = field(default_factory=list)  # of the drives, where they tell
    drives: Drives | None = None  # None: they cannot be set up again from here
    on_fault: Callable[[str], None] = lambda text: None
    dock: LoadingDock = field(init=False)
    _lease: Lease | None = None

    def __post_init__(self) -> None:
        c = self.robot.configuration
        self.dock = LoadingDock(c.joint_names, limits_of(c), c.trajectory.ramp_s)
        self.control.on_close = self._on_close

    # --- after every tick -------------------------------------------------------------------

    def doors(self) -> None:
        """Publish the tick, log its events, serve the control socket: bounded work."""
        cycle = self.loop.cycle
        if self.control.readers and cycle.decision is not None:
            self.control.publish(cycle.state(self.loop.wakeup))
        for event in cycle.events:
            place = {"kind": event.kind, "tick": cycle.tick}
            _log.log(_LEVELS[event.kind], "%s", event.text, extra=place)
            if event.kind == "fault":
                self.on_fault(event.text)
            if event.kind == "mode":
                self.notifier.status(self.summary())
        # After the State, which tells of what was decided in its tick: the next one tells of this.
        self._check_lease()
        self.control.poll(self.handle, DOORS_SHARE * self.robot.configuration.period_s)
        self.notifier.ticked(self.loop.wakeup.monotonic_s)

    def summary(self) -> str:
        """The mode and its cause, in one line."""
        machine = self.loop.cycle.controller.machine
        return f"{_outcome(machine)}: {machine.cause}"

    def handle(self, request: Request, peer: Peer) -> Reply:
        """Carry out one request; a refusal gives every reason."""
        if misplaced := _misplaced(request):
            return self._reply(request, misplaced)
        controller = self.loop.cycle.controller
        who = str(Owner(peer.uid, peer.pid))
        match request.command:
            case "status":
                reply = self._reply(request, [], status=self.status())
            case "subscribe":
                reply = self._reply(request, [], snapshot=self.snapshot())
            case "load":
                reply = self._load(request, peer)
            case "gain":
                reply = self._gain(request, who)
            case "arm":
                reply = self._arm(request, peer)
            case command:
                path = self.dock.take(peer.connection) if request.loaded else None
                event = EVENT_OF_COMMAND[command]
                reasons = self._renewed() if event is Event.RESET else []
                reasons = reasons or controller.request(event, who, self.loop.time_s, path)
                reply = self._reply(request, reasons)
        return reply

    def _reply(
        self,
        request: Request,
        reasons: list[str],
        *,
        checks: Sequence[Check] = (),
        said: str = "",
        row: int | None = None,
        status: Status | None = None,
        snapshot: Snapshot | None = None,
        more: str = "",
    ) -> Reply:
        machine = self.loop.cycle.controller.machine
        outcome = "refused" if reasons else said or _outcome(machine) + more
        return Reply(
            ok=not reasons,
            message=f"{request.command}: {outcome}",
            reasons=reasons,
            mode=machine.mode.value,
            armed=machine.armed,
            checks=list(checks),
            row=row,
            status=status,
            snapshot=snapshot,
        )

    def _arm(self, request: Request, peer: Peer) -> Reply:
        """Arm, or renew: whoever holds the lease need not pass the checks again."""
        controller, now = self.loop.cycle.controller, self.loop.time_s
        owner = Owner(peer.uid, peer.pid, 0 if request.detached else peer.connection)
        duration = request.lease_s or (PERSON_S if request.detached else PROGRAM_S)
        held = self._lease if controller.machine.armed else None
        if held and (refusal := held.refusal(owner, now)):
            return self._reply(request, [refusal])
        checks = [] if held else self.loop.cycle.checks()
        reasons = [] if held else controller.arm(f"{owner}, for {in_words(duration)}")
        if not reasons:
            self._lease = Lease(owner, now + duration)
            self.control.spare = owner.connection
        return self._reply(request, reasons, checks=checks, more=f" for {in_words(duration)}")

    def _check_lease(self, closed: int = 0) -> None:
        """End what has run out, or was held by connection number `closed`."""
        lease, controller = self._lease, self.loop.cycle.controller
        if lease is None:
            return
        if not controller.machine.armed:
            self._lease = None
        elif why := lease.ended(self.loop.time_s, closed):
            self._lease = None
            controller.disarm(why, self.loop.time_s)

    def _on_close(self, peer: Peer) -> None:
        self.dock.release(peer.connection)
        self._check_lease(peer.connection)

    def _permit(self) -> Permit | None:
        lease = self._lease
        if lease is None or not self.loop.cycle.controller.machine.armed:
            return None
        return Permit(
            uid=lease.owner.uid,
            pid=lease.owner.pid,
            detached=lease.owner.connection == 0,
            left_s=lease.left_s(self.loop.time_s),
        )

    def _load(self, request: Request, peer: Peer) -> Reply:
        try:
            if request.header is not None:
                self.dock.begin(request.header, peer.connection)
            if request.rows is not None:
                self.dock.append(request.rows, peer.connection)
        except TrajectoryError as error:
            return self._reply(request, [str(error)], row=error.row)
        return self._reply(request, [])

    def _gain(self, request: Request, who: str) -> Reply:
        joint, gain = request.joint, request.gain
        if joint is None or gain is None:
            return self._reply(request, ["it takes a `joint` and a `gain`"])
        reasons = self.loop.cycle.controller.set_gain(joint, gain, who)
        return self._reply(request, reasons, said=f"{joint} {gain:g} rad/s per Nm")

    def _renewed(self) -> list[str]:
        """Before a reset: set drives up again that need it; returns why that failed.

        By SDO, so no tick happens meanwhile: the arm stands in quick stop or without torque. The
        watchdog is fed as long as drives answer or are given up.
        """
        cycle = self.loop.cycle
        joints = cycle.arm.unfit() if cycle.controller.faulted else []
        if not joints:
            return []
        if self.drives is None:
            names = ", ".join(cycle.arm.names[i] for i in joints)
            return [f"these drives have lost their set-up, start the daemon again: {names}"]
        try:
            self.drives.renew(joints, lambda: self.notifier.ticked(self.loop.now_s))
        except ContactdError as error:
            cycle.arm.listen_again(self.loop.time_s)
            return str(error).splitlines()
        else:
            cycle.arm.start(self.loop.time_s)
            return []
        finally:
            self.loop.resume()

    def status(self) -> Status:
        """For `contactctl status`."""
        loop, c = self.loop, self.robot.configuration
        cycle = loop.cycle
        samples, estimate = cycle.samples, cycle.estimate
        zeros = [0.0] * len(c.joints)
        machine = cycle.controller.machine
        return Status(
            name=c.name,
            configuration=str(self.robot.path),
            pid=self.pid,
            uptime_s=loop.time_s,
            mode=machine.mode.value,
            armed=machine.armed,
            permit=self._permit(),
            cause=machine.cause,
            trajectory=self._trajectory(),
            checks=cycle.checks(),
            cycles=cycle.tick + 1,
            missed=loop.missed,
            lateness_max_us=loop.lateness_max_s * 1e6,
            work_max_us=loop.work_max_s * 1e6,
            realtime=self.realtime,
            readers=len(self.control.readers),
            joints=c.joint_names,
            identities=[str(identity) for identity in self.drives.identities]
            if self.drives
            else [],
            drives=[DRIVE_STATE_NAMES[s] for s in samples.states] if samples else [],
            position=finite_list(samples.link_position) if samples else zeros,
            residual=estimate.residual.tolist() if estimate else zeros,
            threshold=estimate.threshold.tolist() if estimate else zeros,
            side=[SIDE_NAMES[s] for s in estimate.side.tolist()] if estimate else [],
            gain=cycle.controller.motion.gains.goal.tolist(),
            age_ticks=samples.age_ticks.tolist() if samples else [],
            serials=self.serials,
        )

    def _trajectory(self) -> Trajectory:
        controller = self.loop.cycle.controller
        place, state = controller.next_place(), controller.machine.trajectory
        end = place.path.duration
        return Trajectory(
            name=place.path.name,
            state=state,
            time_s=place.s,
            duration_s=end if math.isfinite(end) else None,
        )

    def snapshot(self) -> Snapshot:
        """What a reader needs beside the States. Raises ControlError before the first sample."""
        c, cycle = self.robot.configuration, self.loop.cycle
        if cycle.decision is None:
            raise ControlError("the drives have not sent all their samples yet; try again")
        return Snapshot(
            joints=c.joint_names,
            half_gap=[joint.half_gap for joint in c.joints],
            thresholds=[joint.thresholds.contact for joint in c.joints],
            period_s=c.period_s,
            tick=cycle.tick,
            memory=cycle.estimator.memory(),
            configuration=self.robot.text,
            urdf=self.robot.urdf,
            identified=self.robot.identified_text,
            program=f"contactd {version('contactd')}",
        )

    # --- the end ----------------------------------------------------------------------------

    def wind_down(self, why: str) -> list[str]:
        """Decelerate, stop, let every joint end as configured, and see that it did.

        Returns the names of drives that did not follow. The loop goes on ticking meanwhile, and
        so does our heartbeat; it ends with the last tick.
        """
        cycle = self.loop.cycle
        controller, c = cycle.controller, self.robot.configuration
        controller.request(Event.DISABLE, why, self.loop.time_s)
        self._tick_until(
            lambda: controller.machine.mode in (Mode.OFF, Mode.FAULTED),
            # A joint that does not stop in time becomes a fault, and then a quick stop.
            c.supervisor.stop_timeout_s + END_PATIENCE_S,
        )
        self._tick_until(lambda: not self._stragglers(), END_PATIENCE_S)
        return self._stragglers()

    def _tick_until(self, done: Callable[[], bool], patience_s: float) -> None:
        end = self.loop.time_s + patience_s
        self.loop.run(self.doors, lambda: not done() and self.loop.time_s < end)

    def _stragglers(self) -> list[str]:
        """Drives that have not reached what was last asked of them."""
        cycle = self.loop.cycle
        if cycle.samples is None or cycle.decision is None:
            return []
        pairs = zip(cycle.samples.states, cycle.decision.power, strict=True)
        wrong = np.flatnonzero([not reached(state, target) for state, target in pairs])
        return [self.robot.configuration.joints[i].name for i in wrong]
