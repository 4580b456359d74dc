"""The running daemon in words and figures: for `contactctl status`, and for new readers."""

import math
from collections.abc import Sequence
from importlib.metadata import version

from daemon.config.load import Robot
from daemon.faults.finding import advice_on
from daemon.protocol.messages import STATE_FORMAT, Grant, Permit, Snapshot, Status, Trajectory
from daemon.tick.controller import Controller
from daemon.tick.loop import Loop
from daemon.tick.telemetry import DRIVE_STATE_NAMES, SIDE_NAMES, finite_list
from daemon.tick.tick import Tick
from errors import ControlError


def status_of(
    robot: Robot,
    loop: Loop,
    *,
    place: str,
    pid: int,
    permit: Permit | None,
    realtime: list[Grant],
    readers: int,
    identities: Sequence[object],
    serials: list[int | None],
) -> Status:
    """Everything that a person asks for; `place` is that of config.yaml, whoever asks from where;
    `identities` and `serials` are the drives'."""
    c, tick = robot.configuration, loop.tick
    last = tick.last
    samples, estimate = (last.samples, last.estimate) if last else (None, None)
    zeros = [0.0] * len(c.joints)
    machine = tick.controller.machine
    return Status(
        name=c.name,
        configuration=place,
        pid=pid,
        uptime_s=loop.time_s,
        mode=machine.mode,
        armed=machine.armed,
        permit=permit,
        cause=machine.cause,
        advice="" if machine.armed else advice_on(machine.cause),
        trajectory=_trajectory(tick.controller),
        checks=list(tick.check_arming(loop.time_s).checks),
        ticks=tick.number + 1,
        missed=loop.missed,
        lateness_max_us=loop.lateness_max_s * 1e6,
        work_max_us=loop.work_max_s * 1e6,
        realtime=realtime,
        readers=readers,
        joints=c.joint_names,
        identities=[str(identity) for identity in identities],
        drives=[DRIVE_STATE_NAMES[s] for s in samples.states] if samples else [],
        link_position=finite_list(samples.link_position) if samples else zeros,
        residual=estimate.residual.tolist() if estimate else zeros,
        threshold=estimate.threshold.tolist() if estimate else zeros,
        side=[SIDE_NAMES[s] for s in estimate.side.tolist()] if estimate else [],
        gain=tick.controller.motion.gains.goal.tolist(),
        age_ticks=samples.age_ticks.tolist() if samples else [],
        serials=serials,
    )


def _trajectory(controller: Controller) -> Trajectory:
    place, state = controller.next_place(), controller.machine.trajectory
    end = place.path.duration
    return Trajectory(
        name=place.path.name,
        state=state,
        time_s=place.s,
        duration_s=end if math.isfinite(end) else None,
    )


def snapshot_of(robot: Robot, tick: Tick) -> Snapshot:
    """What a reader needs beside the States. Raises ControlError before the first sample."""
    c = robot.configuration
    last = tick.last
    if last is None or last.decision is None:
        raise ControlError("the drives have not sent all their samples yet; try again")
    return Snapshot(
        format=STATE_FORMAT,
        joints=c.joint_names,
        half_gap=[joint.half_gap for joint in c.joints],
        thresholds=[joint.thresholds.contact for joint in c.joints],
        period_s=c.period_s,
        tick=last.number,
        memory=tick.estimator.memory(),
        configuration=robot.text,
        urdf=robot.urdf,
        identified=robot.identified_text,
        program=f"contactd {version('contactd')}",
    )
