"""State of a tick, its record for readers and recordings, and the Snapshot that is sent before it.

Everything is JSON. Numbers are encoded without loss (shortest round-trip representation), so a
recording can be replayed bit-identically. Vectors have one entry per joint, in the order of
`Snapshot.joints`, SI units at the link side.
"""

from typing import Any, Literal

import msgspec

from daemon.modes.table import Mode
from estimator.payload import Payload

PerJoint = list[float]
"""One number per joint, in the order of `Snapshot.joints`, SI at the link side."""

SideName = Literal["left", "gap", "right", "unknown"]
"""Gap state of a joint: name of `motor_position.Side`."""


class Permit(msgspec.Struct, frozen=True, kw_only=True):
    """Owner of the lease on the armed arm, and the time it has left."""

    uid: int
    pid: int
    detached: bool  # ends by time alone; otherwise also with the connection of `pid`
    left_s: float
    on_behalf_of: str = ""  # as stated by the owner


class StreamState(msgspec.Struct, frozen=True, kw_only=True):
    """Stream of targets that the arm follows, and its statistics."""

    sender: str
    phase: Literal["joining", "following", "stalled", "waiting", "interrupted", "paused"]
    target: PerJoint  # newest [rad]
    age_s: float  # since it was received
    rate_hz: float | None  # of the sender, by its own times; None before the second target
    jitter_s: float  # largest lateness of the last seconds
    delay_s: float  # by which the arm follows behind the sender
    lost: int  # targets never received
    dropped: int  # targets out of order, repeated, or too late
    bounded: int  # targets outside the joint limits, or too fast
    refused: int  # targets that were not finite
    after_contact: Literal["hold", "rejoin"]  # continuation once a contact is over
    contact: str = ""  # description of one that lasts, or ended less than 0.5 s ago


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """Contact: the residual of a joint passed one of its levels."""

    joint: str
    torque: float  # the residual, signed [Nm]
    threshold: float  # the level it passed [Nm]
    level: Literal["contact", "collision"]
    side: SideName


class Wrench(msgspec.Struct, frozen=True, kw_only=True):
    """External force at the tool, in the axes of its frame; `contactctl status` names both. It is
    valid if a single force acts, at the tool: see `misfit`."""

    force: list[float]  # x y z [N], along the observable directions; zero if nothing acts
    covariance: list[float]  # of its error, xx xy xz yy yz zz [N2]
    unseen: list[list[float]]  # directions x y z that are not observable
    strength: float  # ratio to its level: below 1 nothing acts
    misfit: float  # of one force at the tool to the residuals: about 1; above 2: no such force


class Near(msgspec.Struct, frozen=True, kw_only=True):
    """Nearest guarded pair among the shapes of the arm and its surroundings."""

    pair: list[str]  # their names
    distance: float  # negative where they overlap [m]
    slows: bool  # a joint is slowed for this or another pair


class Meeting(msgspec.Struct, frozen=True, kw_only=True):
    """Collision of two shapes on a path that was refused."""

    pair: list[str]  # their names
    position: PerJoint  # of the links there [rad]
    text: str  # reason for the refusal


class Notice(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Event of one tick: a contact, a fault, or (`mode`) a change of mode or permission, or other
    news, as `what: cause`; ` -> ` in it is a change of mode, or of a gain."""

    kind: Literal["mode", "contact", "fault"]
    text: str
    contact: Contact | None = None


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """Timing of the loop: the only fields of a State that differ between two lockstep runs with the
    same seed."""

    wall_s: float  # Unix time of the tick
    monotonic_s: float  # CLOCK_MONOTONIC of the wake-up
    lateness_us: float  # wake-up after the deadline
    work_us: float  # from the wake-up to the last frame sent, in the previous tick
    missed: int  # deadlines missed since the start
    doors_us: float = 0.0  # spent on clients and the log, after the previous tick


class State(msgspec.Struct, frozen=True, kw_only=True):
    """Record of one tick: its measurements, estimates and decisions."""

    tick: int
    time_s: float  # time of the tick since the loop started
    interval_s: float  # since the previous tick
    mode: Mode
    armed: bool
    cause: str  # reason for this mode
    moving: bool  # a trajectory is running, or will continue after this contact
    fresh: list[bool]  # joints whose samples came in time; others have their last values
    drives: list[str]  # CiA 402 states
    # measured, input of the estimator
    current: PerJoint  # [A]
    link_position: PerJoint  # q [rad]
    motor_velocity: PerJoint  # theta_dot [rad/s]
    motor_position: PerJoint | None  # theta [rad], if the drives measure it
    # estimated
    link_velocity: PerJoint  # q_dot [rad/s]
    motor_estimate: PerJoint  # theta used [rad]
    phi: PerJoint  # phi = q - theta [rad]
    phi_sigma: PerJoint  # standard uncertainty of phi [rad]
    side: list[SideName]
    motor_torque: PerJoint  # tau_M = K_c * current [Nm]
    residual: PerJoint  # [Nm]
    threshold: PerJoint  # in force in this tick [Nm]
    thresholded: PerJoint  # sign(r) max(|r| - threshold, 0) [Nm]
    touched_link: str  # by its joint; it may be one further out; empty: no contact, or unknown
    beside: dict[str, PerJoint]  # other residuals on the same samples [Nm]
    flags: list[str]  # warnings of the estimator
    # decided
    reference: PerJoint  # desired q [rad]
    setpoint: PerJoint  # target velocity [rad/s]
    quiet_s: float  # since the last tick with a non-zero thresholded residual
    notices: list[Notice]
    timing: Timing
    unproved: list[str] = []  # joints commanded to stop and not confirmed at standstill
    silenced: bool = False  # the daemon sends nothing to the drives until `reset`
    sensing: list[bool] | None = None  # joints that sense contact now; None in format 1
    sensing_since_s: PerJoint | None = None  # time at which that last changed [s]
    # k: share of each configured contact level that learning leaves in force; None in recordings
    # from before it was published
    level_share: PerJoint | None = None
    permit: Permit | None = None  # while armed; None also in recordings from before it existed
    payload: Payload | None = None  # included in the model in this tick
    recognised: Payload | None = None  # unannounced payload; nothing is learned in this tick
    stream: StreamState | None = None  # while a stream is followed, or waits after a contact
    wrench: Wrench | None = None  # at the tool; None in recordings from before it was published
    # Left out without shapes, and in a mode in which the arm does not move.
    near: Near | msgspec.UnsetType = msgspec.UNSET
    # Left out unless the last requested path was refused for it.
    meeting: Meeting | msgspec.UnsetType = msgspec.UNSET
    # Guide of the hand that leads the arm, as `contactctl guide` shows it. Left out without one.
    guide: str | msgspec.UnsetType = msgspec.UNSET


STATE_FORMAT = 7
"""Version of State and Snapshot. It rises when a field changes its name or its meaning; a new field
with a default needs no new version. Recordings of every version from 1 on stay readable."""


def format_refusal(version: int) -> str:
    """Reason why States of this version are not read; empty if they are."""
    if version < 1:
        return "of a contactd before format 1, whose States have other fields: record anew"
    if version > STATE_FORMAT:
        return f"of format {version}; this contactd reads up to {STATE_FORMAT}: use a newer one"
    return ""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Context of a recording: everything needed to read its States. Sent to each reader first."""

    format: int = 0  # STATE_FORMAT of its program; 0: made before there was one

    joints: list[str]
    half_gap: PerJoint
    thresholds: PerJoint
    period_s: float
    tick: int  # `memory` is the estimator's after this tick
    memory: dict[str, Any]
    configuration: str  # text of config.yaml
    urdf: str  # text of the URDF
    identified: str = ""  # text of identified.yaml
    program: str  # name and version
    bus_load: float | None = None  # share of the bus that periodic frames take at worst
    wrench_axes: str = ""  # link of the URDF along whose axes each State's `wrench` is ...
    wrench_point: list[float] = []  # ... and where in that link's frame, x y z [m]
    walls: dict[str, Any] | None = None  # content of shapes.yaml and surroundings.yaml
    quiet_s: float = 0.0  # `admittance.quiet_s`, up to which `State.quiet_s` counts
