"""Telemetry of a tick: its record as a State, with names and lists instead of enums and arrays."""

from typing import Any, Final

import numpy as np

from daemon.protocol.messages import Contact, Notice, PerJoint, Permit, SideName, State, Timing
from daemon.tick.record import TickRecord
from drivers.cia402 import DriveState
from estimator import contact as estimator_contact
from estimator.estimate import Estimate, Flag
from estimator.motor_position import Side

SIDE_NAMES: dict[int, SideName] = {
    Side.LEFT: "left",
    Side.GAP: "gap",
    Side.RIGHT: "right",
    Side.UNKNOWN: "unknown",
}
DRIVE_STATE_NAMES = {state: state.name.lower().replace("_", " ") for state in DriveState}
FLAG_NAMES = {flag: flag.name.lower() for flag in Flag if flag.name}
# Fields of a State that are a vector of the estimate, with its name there. What is in words
# (`estimated`) comes beside them.
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


def state_of(record: TickRecord, permit: Permit | None = None) -> State:
    """State that is published of a tick, with the permit that was in force in it. Raises
    RuntimeError before the first complete samples."""
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
        drives=[DRIVE_STATE_NAMES[state] for state in samples.states],
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
    """Fields of a State that come from an estimate, by name: what a replay must reproduce."""
    return {
        **{field: getattr(estimate, name).tolist() for field, name in ESTIMATED.items()},
        "side": [SIDE_NAMES[side] for side in estimate.side.tolist()],
        "touched_link": estimate.touched_link,
        "beside": {name: values.tolist() for name, values in estimate.beside.items()},
        "flags": [FLAG_NAMES[flag] for flag in estimate.flags],
    }


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
