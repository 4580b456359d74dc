"""Messages of the daemon's sockets, as the dictionaries that JSON makes.

Made from the code by `make reference`: change them in `daemon/protocol/`. A key that is
NotRequired may be missing. Vectors are in the order of `Snapshot.joints`, SI at the link side.
"""
# ruff: noqa: PLC0414 - other programs take all names from here

from typing import Any, Final, Literal, NotRequired, TypedDict

from contactd_client.requests import Command as Command
from contactd_client.requests import GuideAxes as GuideAxes
from contactd_client.requests import Header as Header
from contactd_client.requests import Request as Request

STATE_FORMAT: Final = 7
Mode = Literal[
    "off", "enabling", "holding", "tracking", "admittance", "retracting", "returning", "releasing",
    "stopping", "faulted",
]  # fmt: skip


class Check(TypedDict):
    """Arming check, with the reason why it passed or failed."""

    name: str
    passed: bool
    text: str


class ToolForce(TypedDict):
    """Smallest detected forces at the tool; directions along x, y, z of the URDF's root."""

    least_N: float  # in the most sensitive direction
    least_along: list[float]
    most_N: float  # in the least sensitive direction, except those without detection
    most_along: list[float]
    undetected: NotRequired[list[list[float]]]  # directions in which no joint detects a force


class Sensitivity(TypedDict):
    """Smallest contacts that the arm detects in its present pose: torque at each joint, force at
    the tool. With model errors both may be a little larger (docs/estimator.md)."""

    joints: list[str]
    tool: str  # description of the tool point
    # None: a joint that does not sense now, and detects nothing [Nm], every joint at its velocity
    # limit
    moving: list[float | None]
    resting: list[float | None]  # [Nm], every joint at rest
    tool_moving: ToolForce
    tool_resting: ToolForce


class PlannedPath(TypedDict):
    """Path to a pose: a straight line through joint space, on which all joints arrive together."""

    name: str
    joints: list[str]
    start: list[float]  # [rad]
    goal: list[float]  # [rad]
    speed: list[float]  # largest on the path [rad/s]
    duration_s: float  # from standstill to standstill, without a contact
    shapes: NotRequired[bool]  # it is checked against the shapes of the arm and its surroundings


class StreamState(TypedDict):
    """Stream of targets that the arm follows, and its statistics."""

    sender: str
    phase: Literal[
    "following", "interrupted", "joining", "paused", "stalled", "waiting",
]  # fmt: skip
    target: list[float]  # newest [rad]
    age_s: float  # since it was received
    rate_hz: float | None  # of the sender, by its own times; None before the second target
    jitter_s: float  # largest lateness of the last seconds
    delay_s: float  # by which the arm follows behind the sender
    lost: int  # targets never received
    dropped: int  # targets out of order, repeated, or too late
    bounded: int  # targets outside the joint limits, or too fast
    refused: int  # targets that were not finite
    after_contact: Literal["hold", "rejoin"]  # continuation once a contact is over
    contact: NotRequired[str]  # description of one that lasts, or ended less than 0.5 s ago


class Permit(TypedDict):
    """Owner of the lease on the armed arm, and the time it has left."""

    uid: int
    pid: int
    detached: bool  # ends by time alone; otherwise also with the connection of `pid`
    left_s: float
    on_behalf_of: NotRequired[str]  # as stated by the owner


class Trajectory(TypedDict):
    """Trajectory that runs, is interrupted, or would be run by `start`."""

    name: str  # empty if none is configured: `start` then needs a file
    state: Literal["interrupted", "paused", "ready", "running"]
    time_s: float  # path time
    duration_s: float | None  # None: endless
    attended: NotRequired[bool]  # it halts and is forgotten when the program that began it ends


class Grant(TypedDict):
    """One part of the real-time set-up, granted by the machine or not, with its description."""

    name: str
    achieved: bool
    text: str


class Learned(TypedDict):
    """Friction learned since identification. Coulomb and viscous are changes, as shares of the
    identified values: +0.1 is a tenth more. Load is friction per torque that the gear transmits."""

    coulomb: list[float]
    viscous: list[float]
    load: list[float]


class Payload(TypedDict):
    """Mass at the hand, modelled as a point. Bounds are checked by its decoder, and by `of`."""

    mass: float  # [kg]
    com: list[float]  # its centre in the frame of the hand, the URDF's last link [m]
    name: NotRequired[str]  # in the configuration
    # edges of its bounding box about that centre, along the axes of the hand [m]
    box: NotRequired[list[float] | None]


class Wrench(TypedDict):
    """External force at the tool, in the axes of its frame; `contactctl status` names both. It is
    valid if a single force acts, at the tool: see `misfit`."""

    force: list[float]  # x y z [N], along the observable directions; zero if nothing acts
    covariance: list[float]  # of its error, xx xy xz yy yz zz [N2]
    unseen: list[list[float]]  # directions x y z that are not observable
    strength: float  # ratio to its level: below 1 nothing acts
    misfit: float  # of one force at the tool to the residuals: about 1; above 2: no such force


class Near(TypedDict):
    """Nearest guarded pair among the shapes of the arm and its surroundings."""

    pair: list[str]  # their names
    distance: float  # negative where they overlap [m]
    slows: bool  # a joint is slowed for this or another pair


class Status(TypedDict):
    """Status of the daemon, as `contactctl status` shows it."""

    name: str
    configuration: str  # absolute path
    pid: int
    uptime_s: float
    mode: Mode
    armed: bool
    permit: Permit | None  # while armed
    disarmed: NotRequired[str]  # cause of the last disarming; empty before one
    disarmed_s: NotRequired[float]  # when that was, as `uptime_s` counts
    cause: str
    since_s: NotRequired[float | None]  # when `cause` led to this mode, as `uptime_s` counts
    advice: NotRequired[str]  # what to do about the cause, if that is a fault
    trajectory: Trajectory
    stream: NotRequired[StreamState | None]  # while the trajectory is one
    checks: list[Check]  # what arming needs
    ticks: int
    missed: int
    lateness_max_us: float
    work_max_us: float
    realtime: list[Grant]  # parts of the real-time set-up, achieved or not
    readers: int
    joints: list[str]
    identities: NotRequired[list[str]]  # of the drives: make, revision, serial number
    drives: list[str]
    link_position: list[float]
    residual: list[float]
    threshold: list[float]
    contact: NotRequired[list[float]]  # configured contact levels [Nm]
    least: NotRequired[list[float]]  # lowest contact levels that learning may set [Nm]
    level_share: NotRequired[list[float]]  # k: share of the contact levels that learning leaves now
    side: list[Literal["gap", "left", "right", "unknown"]]
    gain: list[float]  # K_a, at the end of its ramp [rad/s per Nm]
    age_ticks: list[int]
    serials: NotRequired[list[int | None]]  # 0x1018:4 of the drives
    unproved: NotRequired[list[str]]  # joints commanded to stop and not confirmed at standstill
    silenced: NotRequired[bool]  # the daemon sends nothing to the drives until `reset`
    sensitivity: NotRequired[Sensitivity | None]  # None before the first samples
    # joints that sense contact now; None before the first tick
    sensing: NotRequired[list[bool] | None]
    sensing_since_s: NotRequired[list[float] | None]  # when that last changed, as `uptime_s` counts
    lost: NotRequired[list[float] | None]  # share of recent samples that went missing
    learned: NotRequired[Learned | None]  # None if learning is off
    hand: NotRequired[str]  # the URDF's last link, in whose frame payloads are
    payload: NotRequired[Payload | None]  # announced since the start, and forgotten at its end
    payloads: NotRequired[list[Payload]]  # that can be announced by name
    # poses for `go`, by name: positions by joint [rad]
    poses: NotRequired[dict[str, dict[str, float]]]
    # findings of their trends, a line for each joint (`contactctl health`)
    gears: NotRequired[list[str]]
    # description of an unannounced payload, with advice; empty without one
    recognised: NotRequired[str]
    guide: NotRequired[GuideAxes]  # of an arm that is led by hand
    wrench: NotRequired[Wrench | None]  # force at the tool; None in a mode without contact sensing
    wrench_at: NotRequired[str]  # description of its point
    wrench_axes: NotRequired[str]  # link of the URDF along whose axes it is
    # None without shapes, or in a mode in which the arm does not move
    near: NotRequired[Near | None]
    # reason why no shape is guarded in this run, although the arm has some
    unguarded: NotRequired[str]
    changed: NotRequired[list[str]]  # files that differ from those in use; checked while off
    # reason why a `reload` kept the previous files, with file and field
    not_taken_up: NotRequired[str]


class Snapshot(TypedDict):
    """Context of a recording: everything needed to read its States. Sent to each reader first."""

    format: NotRequired[int]  # STATE_FORMAT of its program; 0: made before there was one
    joints: list[str]
    half_gap: list[float]
    thresholds: list[float]
    period_s: float
    tick: int  # `memory` is the estimator's after this tick
    memory: dict[str, Any]
    configuration: str  # text of config.yaml
    urdf: str  # text of the URDF
    identified: NotRequired[str]  # text of identified.yaml
    program: str  # name and version
    bus_load: NotRequired[float | None]  # share of the bus that periodic frames take at worst
    wrench_axes: NotRequired[str]  # link of the URDF along whose axes each State's `wrench` is ...
    wrench_point: NotRequired[list[float]]  # ... and where in that link's frame, x y z [m]
    walls: NotRequired[dict[str, Any] | None]  # content of shapes.yaml and surroundings.yaml
    quiet_s: NotRequired[float]  # `admittance.quiet_s`, up to which `State.quiet_s` counts


class Reply(TypedDict):
    """Answer to one `Request`: done or refused, with every reason for a refusal."""

    ok: bool
    message: NotRequired[str]
    reasons: NotRequired[list[str]]
    mode: NotRequired[Mode | None]
    armed: NotRequired[bool]
    checks: NotRequired[list[Check]]  # of `arm`
    sensitivity: NotRequired[Sensitivity | None]  # of a successful `arm`
    row: NotRequired[int | None]  # first refused row of a trajectory, from 0
    unproved: NotRequired[list[str]]  # joints commanded to stop and not confirmed at standstill
    # of a successful `start` or `go`, and of a plan: motion that the thresholds do not cover, or
    # that ends nearer to a limit than a joint may get
    warnings: NotRequired[list[str]]
    way: NotRequired[PlannedPath | None]  # of a successful or planned `go`
    stream: NotRequired[StreamState | None]  # of `follow` and `target`
    status: NotRequired[Status | None]
    snapshot: NotRequired[Snapshot | None]


class Contact(TypedDict):
    """Contact: the residual of a joint passed one of its levels."""

    joint: str
    torque: float  # the residual, signed [Nm]
    threshold: float  # the level it passed [Nm]
    level: Literal["collision", "contact"]
    side: Literal["gap", "left", "right", "unknown"]


class Notice(TypedDict):
    """Event of one tick: a contact, a fault, or (`mode`) a change of mode or permission, or other
    news, as `what: cause`; ` -> ` in it is a change of mode, or of a gain."""

    kind: Literal["contact", "fault", "mode"]
    text: str
    contact: NotRequired[Contact | None]


class Timing(TypedDict):
    """Timing of the loop: the only fields of a State that differ between two lockstep runs with the
    same seed."""

    wall_s: float  # Unix time of the tick
    monotonic_s: float  # CLOCK_MONOTONIC of the wake-up
    lateness_us: float  # wake-up after the deadline
    work_us: float  # from the wake-up to the last frame sent, in the previous tick
    missed: int  # deadlines missed since the start
    doors_us: NotRequired[float]  # spent on clients and the log, after the previous tick


class Meeting(TypedDict):
    """Collision of two shapes on a path that was refused."""

    pair: list[str]  # their names
    position: list[float]  # of the links there [rad]
    text: str  # reason for the refusal


class State(TypedDict):
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
    current: list[float]  # measured, input of the estimator [A]
    link_position: list[float]  # q [rad]
    motor_velocity: list[float]  # theta_dot [rad/s]
    motor_position: list[float] | None  # theta [rad], if the drives measure it
    link_velocity: list[float]  # estimated q_dot [rad/s]
    motor_estimate: list[float]  # theta used [rad]
    phi: list[float]  # phi = q - theta [rad]
    phi_sigma: list[float]  # standard uncertainty of phi [rad]
    side: list[Literal["gap", "left", "right", "unknown"]]
    motor_torque: list[float]  # tau_M = K_c * current [Nm]
    residual: list[float]  # [Nm]
    threshold: list[float]  # in force in this tick [Nm]
    thresholded: list[float]  # sign(r) max(|r| - threshold, 0) [Nm]
    touched_link: str  # by its joint; it may be one further out; empty: no contact, or unknown
    beside: dict[str, list[float]]  # other residuals on the same samples [Nm]
    flags: list[str]  # warnings of the estimator
    reference: list[float]  # decided desired q [rad]
    setpoint: list[float]  # target velocity [rad/s]
    quiet_s: float  # since the last tick with a non-zero thresholded residual
    notices: list[Notice]
    timing: Timing
    unproved: NotRequired[list[str]]  # joints commanded to stop and not confirmed at standstill
    silenced: NotRequired[bool]  # the daemon sends nothing to the drives until `reset`
    sensing: NotRequired[list[bool] | None]  # joints that sense contact now; None in format 1
    sensing_since_s: NotRequired[list[float] | None]  # time at which that last changed [s]
    # k: share of each configured contact level that learning leaves in force; None in recordings
    # from before it was published
    level_share: NotRequired[list[float] | None]
    # while armed; None also in recordings from before it existed
    permit: NotRequired[Permit | None]
    payload: NotRequired[Payload | None]  # included in the model in this tick
    recognised: NotRequired[Payload | None]  # unannounced payload; nothing is learned in this tick
    stream: NotRequired[StreamState | None]  # while a stream is followed, or waits after a contact
    # at the tool; None in recordings from before it was published
    wrench: NotRequired[Wrench | None]
    # Left out without shapes, and in a mode in which the arm does not move.
    near: NotRequired[Near]
    meeting: NotRequired[Meeting]  # Left out unless the last requested path was refused for it.
    # Guide of the hand that leads the arm, as `contactctl guide` shows it. Left out without one.
    guide: NotRequired[str]
