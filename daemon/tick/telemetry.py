"""Telemetry of a tick: its record, and the State built from it, with names and lists instead of
enums and arrays."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.faults.finding import Finding
from daemon.modes.table import Mode
from daemon.motion.target_stream import TargetStream
from daemon.protocol.state import (
    Contact,
    Meeting,
    Near,
    Notice,
    PerJoint,
    Permit,
    SideName,
    State,
    StreamState,
    Timing,
    Wrench,
)
from daemon.tick.decision import Decision
from drivers.api import Samples
from estimator import contact as estimator_contact
from estimator.estimate import Estimate, Flag
from estimator.motor_position import Side
from estimator.payload import Payload
from estimator.walls import Walls
from estimator.wrench import COVARIANCE, FORCE, MISFIT, STRENGTH, UNSEEN, WIDTH

SIDE_NAMES: dict[int, SideName] = {
    Side.LEFT: "left",
    Side.GAP: "gap",
    Side.RIGHT: "right",
    Side.UNKNOWN: "unknown",
}
FLAG_NAMES = {flag: flag.name.lower() for flag in Flag if flag.name}
# Fields of a State that are vectors of the estimate, with their names there; `estimated` adds the
# other fields.
ESTIMATED: Final = {
    "link_velocity": "q_dot",
    "motor_estimate": "theta",
    "phi": "phi",
    "phi_sigma": "phi_sigma",
    "motor_torque": "tau_M",
    "residual": "residual",
    "threshold": "threshold",
    "thresholded": "thresholded",
    "level_share": "level_share",
}


@dataclass(frozen=True, slots=True)
class Wakeup:
    """Wake-up of the loop for a tick: its time, and its lateness."""

    monotonic_s: float = 0.0
    lateness_s: float = 0.0
    work_s: float = 0.0  # of the previous tick
    missed: int = 0  # deadlines, since the start
    left_out: int = 0  # deadlines skipped because this tick was late
    doors_s: float = 0.0  # time for clients and the log, after the previous tick
    wall_s: float = 0.0  # Unix time


ON_TIME = Wakeup()


@dataclass(frozen=True, slots=True, kw_only=True)
class TickRecord:
    """Record of one tick: its measurements, estimates, findings and decisions, with their times;
    arrays of shape (n,), SI at the link.

    Created once at the end of each tick and never changed, so that all queries between two ticks
    (status, arming, the published State) refer to one moment. Fields with a default are missing in
    a log of frames; a tick of the daemon gives every field.
    """

    number: int
    time_s: float  # since the loop started
    wakeup: Wakeup
    samples: Samples
    interval_s: float  # since the previous tick
    estimate: Estimate | None  # None until every joint had sent a sample
    sensing: NDArray[np.bool_]  # joints that sense contact
    sensing_since_s: Vector  # when that changed last [s]
    findings: tuple[Finding, ...] = ()
    decision: Decision | None  # None as long as `estimate` is
    mode: Mode  # after the decision, like all that follows
    armed: bool = False
    cause: str  # of the mode
    moving: bool = False  # a trajectory runs, or continues after this contact
    quiet_s: float = 0.0  # since the last tick with a non-zero thresholded residual
    unproved: tuple[str, ...] = ()  # joints commanded to stop and not confirmed at standstill
    payload: Payload | None = None  # included in the model
    recognised: Payload | None = None  # unannounced payload; learning is suspended meanwhile
    silenced: bool = False  # last stage of a stop: nothing is sent to the drives
    stream: StreamState | None = None  # that the arm follows
    near: Near | UnsetType = UNSET
    meeting: Meeting | UnsetType = UNSET
    guide: str | UnsetType = UNSET
    notices: tuple[Notice, ...]  # news of this tick, and of the requests before it


def state_of(record: TickRecord, permit: Permit | None = None) -> State:
    """Published State of a tick, with the permit that was in force in it. Raises RuntimeError
    before the first complete samples."""
    samples, decision, wakeup = record.samples, record.decision, record.wakeup
    if record.estimate is None or decision is None:
        raise RuntimeError("no complete samples yet")
    motor_position = samples.motor_position
    return State(
        tick=record.number,
        time_s=record.time_s,
        interval_s=record.interval_s,
        mode=record.mode,
        armed=record.armed,
        cause=record.cause,
        moving=record.moving,
        fresh=samples.fresh.tolist(),
        drives=[drive.state for drive in samples.drives],
        current=finite_list(samples.current),
        link_position=finite_list(samples.link_position),
        motor_velocity=finite_list(samples.motor_velocity),
        motor_position=None if motor_position is None else finite_list(motor_position),
        **estimated(record.estimate),
        sensing=record.sensing.tolist(),
        sensing_since_s=record.sensing_since_s.tolist(),
        reference=finite_list(decision.reference),
        setpoint=decision.velocity.tolist(),
        quiet_s=record.quiet_s,
        unproved=list(record.unproved),
        silenced=record.silenced,
        notices=list(record.notices),
        permit=permit,
        payload=record.payload,
        recognised=record.recognised,
        stream=record.stream,
        near=record.near,
        meeting=record.meeting,
        guide=record.guide,
        timing=Timing(
            wall_s=wakeup.wall_s,
            monotonic_s=wakeup.monotonic_s,
            lateness_us=wakeup.lateness_s * 1e6,
            work_us=wakeup.work_s * 1e6,
            doors_us=wakeup.doors_s * 1e6,
            missed=wakeup.missed,
        ),
    )


def estimated(estimate: Estimate) -> dict[str, Any]:
    """Fields of a State that come from an estimate, by name. A replay must reproduce them."""
    return {
        **{field: getattr(estimate, name).tolist() for field, name in ESTIMATED.items()},
        "side": [SIDE_NAMES[side] for side in estimate.side.tolist()],
        "touched_link": estimate.touched_link,
        "beside": {name: values.tolist() for name, values in estimate.beside.items()},
        "flags": [FLAG_NAMES[flag] for flag in estimate.flags],
        "wrench": wrench_of(estimate.wrench),
    }


def wrench_of(row: Vector) -> Wrench:
    """Wrench of the estimate's row (WIDTH,)."""
    values: list[float] = row.tolist()
    directions = [values[k : k + 3] for k in range(UNSEEN, WIDTH, 3)]
    return Wrench(
        force=values[FORCE:COVARIANCE],
        covariance=values[COVARIANCE:STRENGTH],
        unseen=[one for one in directions if any(one)],
        strength=values[STRENGTH],
        misfit=values[MISFIT],
    )


def near_of(walls: Walls | None) -> Near | UnsetType:
    """Nearest guarded pair, as of the last bound by the walls."""
    if walls is None or walls.nearest < 0:
        return UNSET
    clearance = walls.clearance
    pair = [one.name for one in clearance.pairs[clearance.pair[walls.nearest]]]
    return Near(pair=pair, distance=walls.distance, slows=walls.slows)


def stream_state(stream: TargetStream, trajectory: str) -> StreamState:
    """State of a stream; trajectory: that of the mode machine."""
    playout = stream.playout
    return StreamState(
        sender=stream.sender,
        phase=stream.phase.value if trajectory == "running" else trajectory,  # type: ignore[arg-type]
        target=playout.newest.q.tolist(),
        age_s=stream.silent_s,
        rate_hz=1.0 / playout.period_s if playout.period_s else None,
        jitter_s=playout.jitter_s,
        delay_s=stream.delay_s,
        lost=playout.lost,
        dropped=playout.dropped,
        bounded=stream.bounded,
        refused=stream.refused,
        after_contact=stream.settings.after_contact.value,
        contact=stream.contact,
    )


def contact_notice(contact: estimator_contact.Contact) -> Notice:
    """Notice of a contact, for readers and the log."""
    return Notice(
        kind="contact",
        text=f"{contact.joint} {contact.torque:+.2f} Nm ({contact.level})",
        contact=Contact(
            joint=contact.joint,
            torque=contact.torque,
            threshold=contact.threshold,
            level=contact.level,
            side=SIDE_NAMES[contact.side],
        ),
    )


def finite_list(values: np.ndarray) -> PerJoint:
    """Values as a list, NaN as 0: JSON has none, and msgspec would write null instead."""
    return [value if value == value else 0.0 for value in values.tolist()]  # noqa: PLR0124
