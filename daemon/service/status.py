"""Status of the running daemon for `contactctl status`, and its snapshot for new readers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version

from msgspec import to_builtins
from msgspec.structs import replace

from common.errors import ControlError
from daemon.arming.permission import Permission
from daemon.assembly import covered_range
from daemon.config.files import Files
from daemon.config.load import Robot
from daemon.drives import load_of
from daemon.faults.conditions import Condition, Response
from daemon.faults.symptoms import advice_of
from daemon.modes.table import SENSING, Mode
from daemon.motion.covered_range import CoveredRange
from daemon.motion.path import stands
from daemon.protocol.replies import Grant, Learned, Status, Trajectory
from daemon.protocol.state import STATE_FORMAT, Snapshot
from daemon.service.payloads import Payloads
from daemon.service.poses import Poses
from daemon.service.sensitivity import sensitivity_now
from daemon.tick.controller import Controller
from daemon.tick.loop import Loop
from daemon.tick.telemetry import SIDE_NAMES, finite_list, wrench_of
from daemon.tick.tick import Tick

UNGUARDED = "no shape is guarded, as positions are not trusted: see `identification`"
ASK_AGAIN = "request the motion again: it is forgotten when the program that began it ends"


@dataclass(slots=True)
class Process:
    """Properties of the daemon that do not depend on ticks."""

    robot: Robot
    pid: int
    realtime: list[Grant]
    serials: list[int | None] = field(default_factory=list)  # of the drives, if they report them
    not_taken_up: str = ""  # reason why newer files are not in use
    read: Files | None = None  # as they were when the robot was loaded; None: as they are now
    files: Files = field(init=False)
    changed: list[str] = field(default_factory=list)  # files that had changed at the last check
    place: str = field(init=False)  # path of config.yaml; the file system is queried only once
    payloads: Payloads = field(init=False)
    poses: Poses = field(init=False)
    seen: CoveredRange = field(init=False)

    def __post_init__(self) -> None:
        self.files = self.read or Files.of(self.robot)
        self.payloads = Payloads(self.robot)
        self.poses = Poses(self.robot)
        self.seen = covered_range(self.robot)
        self.place = str(self.robot.place())

    def newer(self) -> list[str]:
        """Reason against `enable`: files have changed since they were read. Queries the file
        system."""
        self.changed = self.files.changed()
        if not self.changed:
            return []
        if self.not_taken_up:
            return [f"not taken up: {self.not_taken_up}; correct it, then `contactctl reload`"]
        return [f"changed since it was read: {', '.join(self.changed)}; `contactctl reload`"]


def status_of(
    process: Process,
    loop: Loop,
    permission: Permission,
    identities: Sequence[str],
    readers: int,
    *,
    attended: bool = False,
) -> Status:
    """Status of the daemon: its process, its last tick, and the arming checks now."""
    c, tick, last = process.robot.configuration, loop.tick, loop.tick.last
    samples, estimate = (last.samples, last.estimate) if last else (None, None)
    zeros = [0.0] * len(c.joints)
    machine, unproved, loads = tick.controller.machine, tick.unproved(), tick.loads
    return Status(
        name=c.name,
        configuration=process.place,
        pid=process.pid,
        uptime_s=loop.time_s,
        mode=machine.mode,
        armed=machine.armed,
        permit=permission.permit(loop.time_s),
        disarmed=machine.disarmed[0],
        disarmed_s=machine.disarmed[1],
        cause=machine.cause,
        since_s=machine.entered_s,
        advice=_advice(tick, unproved, attended=attended),
        trajectory=_trajectory(tick.controller, attended=attended),
        stream=last.stream if last else None,
        checks=list(permission.checks.run(loop.time_s).checks),
        ticks=tick.number + 1,
        missed=loop.missed,
        lateness_max_us=loop.lateness_max_s * 1e6,
        work_max_us=loop.work_max_s * 1e6,
        realtime=process.realtime,
        readers=readers,
        joints=c.joint_names,
        identities=list(identities),
        drives=[drive.state for drive in samples.drives] if samples else [],
        link_position=finite_list(samples.link_position) if samples else zeros,
        residual=estimate.residual.tolist() if estimate else zeros,
        threshold=estimate.threshold.tolist() if estimate else zeros,
        contact=[joint.thresholds.contact for joint in c.joints],
        least=c.least_levels,
        level_share=estimate.level_share.tolist() if estimate else [],
        side=[SIDE_NAMES[s] for s in estimate.side.tolist()] if estimate else [],
        gain=tick.controller.motion.gains.goal.tolist(),
        guide=tick.controller.motion.guidance.axes,
        age_ticks=[round(age / c.period_s) for age in samples.age_s.tolist()] if samples else [],
        serials=process.serials,
        unproved=list(unproved),
        silenced=tick.drives.silenced,
        sensitivity=sensitivity_now(tick) if machine.mode in SENSING else None,
        sensing=last.sensing.tolist() if last else None,
        sensing_since_s=last.sensing_since_s.tolist() if last else None,
        lost=tick.losses.share.tolist(),
        learned=_learned(tick),
        hand=process.payloads.hand,
        payload=tick.payload,
        payloads=list(process.payloads.named.values()),
        poses=process.poses.named,
        recognised=f"{loads.words}: {loads.advice}" if loads.found else "",
        wrench=wrench_of(estimate.wrench) if estimate and machine.mode in SENSING else None,
        wrench_at=c.estimator.force_at or tick.estimator.model.tool,
        wrench_axes=c.estimator.force_at or tick.estimator.model.hand,
        near=(last.near or None) if last else None,
        unguarded=UNGUARDED if tick.controller.motion.blind and process.robot.walls else "",
        changed=process.changed,
        not_taken_up=process.not_taken_up if process.changed else "",
    )


def _advice(tick: Tick, unproved: Sequence[str], *, attended: bool) -> str:
    """Advice, one item per line: first for a joint not confirmed at standstill, then for the cause,
    a contact that is still present, the trajectory that waits, a possible load, and conditions that
    do not stop the arm."""
    machine, finding = tick.controller.machine, tick.controller.finding
    advice = []
    if unproved and tick.controller.faulted:
        not_stopped = Condition.UNPROVED if tick.drives.silenced else Condition.NOT_SEEN_TO_STOP
        advice.append(advice_of(not_stopped))
    if finding and not machine.armed:
        advice.append(finding.advice)
    if pressed := tick.controller.pressed:
        advice.append(f"free the arm ({pressed}), or `contactctl disable`")
    elif machine.paused and machine.mode is Mode.HOLDING:
        if load := tick.loads.advice:
            advice.append(f"announce the payload of the hand ({load}), or remove it")
        ask_again = attended and tick.controller.stream is None
        advice.append(ASK_AGAIN if ask_again else "`contactctl start` continues the trajectory")
    advice += [words for words in (tick.loads.hint, tick.learning_notices.load) if words]
    found = tick.last.findings if tick.last else ()
    advice += [one.advice for one in found if one.response is Response.CONTINUE]
    return "\n".join(dict.fromkeys(advice))


def _learned(tick: Tick) -> Learned | None:
    if not tick.estimator.settings.learning:
        return None
    friction = tick.estimator.learned()
    return Learned(
        coulomb=(friction.coulomb - 1.0).tolist(),
        viscous=(friction.viscous - 1.0).tolist(),
        load=friction.load.tolist(),
    )


def _trajectory(controller: Controller, *, attended: bool) -> Trajectory:
    place, state = controller.next_place(), controller.machine.trajectory
    end = place.path.duration
    return Trajectory(
        name="" if stands(place.path) else place.path.name,
        state=state,
        time_s=place.s,
        duration_s=end if math.isfinite(end) else None,
        attended=attended and state != "ready",
    )


def snapshot_of(robot: Robot, tick: Tick) -> Snapshot:
    """Snapshot for a reader of States. Raises ControlError before the first complete samples."""
    last = tick.last
    if last is None or last.decision is None:
        raise ControlError("the drives have not sent all their samples yet; try again")
    return replace(context_of(robot), tick=last.number, memory=tick.estimator.memory())


def context_of(robot: Robot) -> Snapshot:
    """Snapshot of the arm before its first tick, without memory of the estimator."""
    c = robot.configuration
    return Snapshot(
        format=STATE_FORMAT,
        joints=c.joint_names,
        half_gap=[joint.half_gap for joint in c.joints],
        thresholds=[joint.thresholds.contact for joint in c.joints],
        period_s=c.period_s,
        tick=-1,
        memory={},
        configuration=robot.text,
        urdf=robot.urdf,
        identified=robot.identified_text,
        program=f"contactd {version('contactd')}",
        bus_load=load_of(c),
        wrench_axes=c.estimator.force_at or robot.model.hand,
        wrench_point=[0.0] * 3 if c.estimator.force_at else robot.model.tool_place.tolist(),
        walls=to_builtins(robot.walls),
        quiet_s=c.admittance.quiet_s,
    )
