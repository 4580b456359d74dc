"""Messages of the daemon's sockets, as the dictionaries that they are in JSON.

Made from the code by `make reference`: change them in `daemon/protocol/`. A key that is
NotRequired may be missing: from a daemon that is older, or where it says nothing. Vectors have one
number per joint, in the order of `Snapshot.joints`, SI units at the link side.
"""

from typing import Any, Final, Literal, NotRequired, TypedDict

STATE_FORMAT: Final = 6
Command = Literal[
    "enable",
    "load",
    "start",
    "go",
    "pause",
    "arm",
    "renew",
    "disarm",
    "stop",
    "disable",
    "reset",
    "gain",
    "payload",
    "reload",
    "status",
    "subscribe",
]
Mode = Literal[
    "off",
    "enabling",
    "holding",
    "tracking",
    "admittance",
    "retracting",
    "returning",
    "releasing",
    "stopping",
    "faulted",
]


class Header(TypedDict):
    """Header of a trajectory, whose rows are [t, q of each joint, q_dot of each joint]."""

    name: str
    # all others hold
    joints: list[str]
    # may begin from any pose, run as displacements
    from_here: NotRequired[bool]
    # by the motors' velocity alone, whatever the links do
    motors_only: NotRequired[bool]


class Check(TypedDict):
    """One check before the arm may be armed, with the reason why it passed or failed."""

    name: str
    passed: bool
    text: str


class ToolForce(TypedDict):
    """Forces at the tool that the arm detects; directions along x, y, z of the URDF's root."""

    # in the most sensitive direction
    least_N: float
    least_along: list[float]
    # in the least sensitive direction, except those without detection
    most_N: float
    most_along: list[float]
    # directions in which no joint detects a force
    undetected: NotRequired[list[list[float]]]


class Sensitivity(TypedDict):
    """Smallest touches that the arm detects in its present pose: torque at each joint, force at the
    tool. With errors of the model both may be a little larger (docs/estimator.md)."""

    joints: list[str]
    # description of the tool point
    tool: str
    # None: a joint that does not sense now, and detects nothing [Nm], every joint at its velocity
    # limit
    moving: list[float | None]
    # [Nm], every joint at rest
    resting: list[float | None]
    tool_moving: ToolForce
    tool_resting: ToolForce


class Way(TypedDict):
    """Way to a pose: a straight line through joint space, on which all joints arrive together.
    Obstacles are not taken into account."""

    name: str
    joints: list[str]
    # [rad]
    start: list[float]
    # [rad]
    goal: list[float]
    # largest on the way [rad/s]
    speed: list[float]
    # from standstill to standstill, unless a contact comes in between
    duration_s: float


class Permit(TypedDict):
    """Owner of the lease on the armed arm, and the time it has left."""

    uid: int
    pid: int
    # ends by time alone; otherwise also with the connection of `pid`
    detached: bool
    left_s: float
    # as stated by the owner
    on_behalf_of: NotRequired[str]


class Trajectory(TypedDict):
    """The trajectory that runs, is interrupted, or would be run by `start`."""

    # empty where none is configured: `start` needs a file then
    name: str
    state: Literal["interrupted", "paused", "ready", "running"]
    # path time
    time_s: float
    # None: it has no end
    duration_s: float | None
    # it halts, and is forgotten, when the program that began it ends
    attended: NotRequired[bool]


class Grant(TypedDict):
    """One part of the real-time set-up, granted by the machine or not, with its description."""

    name: str
    achieved: bool
    text: str


class Learned(TypedDict):
    """Changes learned since identification, as shares of the identified values: +0.1 is a tenth
    more."""

    coulomb: list[float]
    viscous: list[float]


class Payload(TypedDict):
    """Mass at the hand, taken for a point. Bounds are checked where it is decoded, and by `of`."""

    # [kg]
    mass: float
    # its centre in the frame of the hand, the URDF's last link [m]
    com: list[float]
    # in the configuration
    name: NotRequired[str]


class Status(TypedDict):
    """Status of the daemon, as `contactctl status` shows it."""

    name: str
    # absolute path
    configuration: str
    pid: int
    uptime_s: float
    mode: Mode
    armed: bool
    # while armed
    permit: Permit | None
    cause: str
    # when that led to this mode, as `uptime_s` counts
    since_s: NotRequired[float | None]
    # what to do about the cause, if that is a fault
    advice: NotRequired[str]
    trajectory: Trajectory
    # what arming needs
    checks: list[Check]
    ticks: int
    missed: int
    lateness_max_us: float
    work_max_us: float
    # parts of the real-time set-up, achieved or not
    realtime: list[Grant]
    readers: int
    joints: list[str]
    # of the drives: make, revision, serial number
    identities: NotRequired[list[str]]
    drives: list[str]
    link_position: list[float]
    residual: list[float]
    threshold: list[float]
    side: list[Literal["gap", "left", "right", "unknown"]]
    # K_a, as it is or is about to be [rad/s per Nm]
    gain: list[float]
    age_ticks: list[int]
    # 0x1018:4 of the drives
    serials: NotRequired[list[int | None]]
    # joints commanded to stop and not confirmed at standstill
    unproved: NotRequired[list[str]]
    # the daemon sends nothing to the drives until `reset`
    silenced: NotRequired[bool]
    # None before the first samples
    sensitivity: NotRequired[Sensitivity | None]
    # joints that sense contact now; None before the first tick
    sensing: NotRequired[list[bool] | None]
    # when that last changed, as `uptime_s` counts
    sensing_since_s: NotRequired[list[float] | None]
    # share of recent samples that went missing
    lost: NotRequired[list[float] | None]
    # None where nothing is learned
    learned: NotRequired[Learned | None]
    # the URDF's last link, in whose frame payloads are
    hand: NotRequired[str]
    # that was announced since the start, and is forgotten at its end
    payload: NotRequired[Payload | None]
    # that can be announced by name
    payloads: NotRequired[list[Payload]]
    # that `go` can be asked for: joints by name [rad]
    poses: NotRequired[dict[str, dict[str, float]]]
    # findings of their trends, a line for each joint (`contactctl health`)
    gears: NotRequired[list[str]]
    # description of an unannounced payload, with advice; empty without one
    recognised: NotRequired[str]
    # Files that differ from those in use; checked while the drives are off.
    changed: NotRequired[list[str]]
    # reason why a `reload` kept the old ones, with file and field
    not_taken_up: NotRequired[str]


class Snapshot(TypedDict):
    """Context of a recording: everything needed to read its States. Sent to each reader first."""

    # STATE_FORMAT of its program; 0: made before there was one
    format: NotRequired[int]
    joints: list[str]
    half_gap: list[float]
    thresholds: list[float]
    period_s: float
    # `memory` is the estimator's after this tick
    tick: int
    memory: dict[str, Any]
    # text of config.yaml
    configuration: str
    # text of the URDF
    urdf: str
    # text of identified.yaml
    identified: NotRequired[str]
    # name and version
    program: str
    # share of the bus that periodic frames take at worst
    bus_load: NotRequired[float | None]


class Reply(TypedDict):
    """Answer to one `Request`: done or refused, with every reason for a refusal."""

    ok: bool
    message: NotRequired[str]
    reasons: NotRequired[list[str]]
    mode: NotRequired[Mode | None]
    armed: NotRequired[bool]
    # of `arm`
    checks: NotRequired[list[Check]]
    # of `arm` that is done
    sensitivity: NotRequired[Sensitivity | None]
    # of a trajectory: the first that was refused, from 0
    row: NotRequired[int | None]
    # joints commanded to stop and not confirmed at standstill
    unproved: NotRequired[list[str]]
    # of `start` and `go` that are done, and of a plan: beyond what the thresholds cover, or nearer
    # to a limit than a joint may get
    warnings: NotRequired[list[str]]
    # of `go` that is done, or planned
    way: NotRequired[Way | None]
    status: NotRequired[Status | None]
    snapshot: NotRequired[Snapshot | None]


class Contact(TypedDict):
    """Contact: the residual of a joint passed one of its levels."""

    joint: str
    # the residual, signed [Nm]
    torque: float
    # the level it passed [Nm]
    threshold: float
    level: Literal["collision", "contact"]
    side: Literal["gap", "left", "right", "unknown"]


class Notice(TypedDict):
    """Event of one tick: a change of mode or permission, a contact, or a fault."""

    kind: Literal["contact", "fault", "mode"]
    text: str
    contact: NotRequired[Contact | None]


class Timing(TypedDict):
    """Timing of the loop: the only fields of a State that differ between two lockstep runs with one
    seed."""

    # Unix time of the tick
    wall_s: float
    # CLOCK_MONOTONIC of the wake-up
    monotonic_s: float
    # wake-up after the deadline
    lateness_us: float
    # from the wake-up to the last frame sent, in the tick before this one
    work_us: float
    # deadlines missed since the start
    missed: int
    # spent on clients and the log, after the tick before this one
    doors_us: NotRequired[float]


class State(TypedDict):
    """Record of one tick: its measurements, estimates and decisions."""

    tick: int
    # time of the tick since the loop started
    time_s: float
    # since the tick before
    interval_s: float
    mode: Mode
    armed: bool
    # reason for this mode
    cause: str
    # a trajectory is running or will go on after this contact
    moving: bool
    # joints whose samples came in time; of others these are the last
    fresh: list[bool]
    # CiA 402 states
    drives: list[str]
    # measured, input of the estimator [A]
    current: list[float]
    # q [rad]
    link_position: list[float]
    # theta_dot [rad/s]
    motor_velocity: list[float]
    # theta [rad], where the drive has it
    motor_position: list[float] | None
    # estimated q_dot [rad/s]
    link_velocity: list[float]
    # theta used [rad]
    motor_estimate: list[float]
    # phi = q - theta [rad]
    phi: list[float]
    # standard uncertainty of phi [rad]
    phi_sigma: list[float]
    side: list[Literal["gap", "left", "right", "unknown"]]
    # tau_M = K_c * current [Nm]
    motor_torque: list[float]
    # [Nm]
    residual: list[float]
    # in force in this tick [Nm]
    threshold: list[float]
    # sign(r) max(|r| - threshold, 0) [Nm]
    thresholded: list[float]
    # named by its joint; empty: no contact, or its link is not known
    touched_link: str
    # other residuals on the same samples [Nm]
    beside: dict[str, list[float]]
    # warnings of the estimator
    flags: list[str]
    # decided desired q [rad]
    reference: list[float]
    # target velocity [rad/s]
    setpoint: list[float]
    # since the last tick with a non-zero thresholded residual
    quiet_s: float
    notices: list[Notice]
    timing: Timing
    # joints commanded to stop and not confirmed at standstill
    unproved: NotRequired[list[str]]
    # the daemon sends nothing to the drives until `reset`
    silenced: NotRequired[bool]
    # joints that sense contact now; None in format 1
    sensing: NotRequired[list[bool] | None]
    # time at which that last changed [s]
    sensing_since_s: NotRequired[list[float] | None]
    # k: share of each configured contact level that learning leaves in force; None in recordings
    # from before it was published
    level_share: NotRequired[list[float] | None]
    # while armed; None also in recordings from before it existed
    permit: NotRequired[Permit | None]
    # included in the model in this tick
    payload: NotRequired[Payload | None]
    # unannounced payload; nothing is learned in this tick
    recognised: NotRequired[Payload | None]


class Request(TypedDict):
    """One command, with the arguments that only some commands take."""

    command: Command
    # Person or program on whose behalf the client asks, as stated by the client: for the log only,
    # not verified.
    on_behalf_of: NotRequired[str | None]
    # `load`: begins one
    header: NotRequired[Header | None]
    # `load`: more of it
    rows: NotRequired[list[list[float]] | None]
    # `start`: run what this connection has loaded
    loaded: NotRequired[bool]
    # `start`, `go`: it halts when this connection ends, or sends nothing for 2 s, and is forgotten
    attended: NotRequired[bool]
    # `go`: to this one, or
    pose: NotRequired[str | None]
    # `go`: to these positions, within the joints' limits; joints that are not named stay [rad]
    targets: NotRequired[dict[str, float] | None]
    # `go`: of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: NotRequired[float | None]
    # `go`: answer only what it would do
    plan: NotRequired[bool]
    # `go`: positions for which it was planned; refused if the arm is elsewhere by now [rad]
    planned_from: NotRequired[list[float] | None]
    # `arm`, `renew`: from now; 0.5 s unless given
    lease_s: NotRequired[float | None]
    # `arm`: the lease outlives this connection, and any process of this user may arm again
    detached: NotRequired[bool]
    # `gain`
    joint: NotRequired[str]
    # `gain`: K_a from now on, 0 or at least LEAST_GAIN [rad/s per Nm]
    gain: NotRequired[float]
    # `payload`: by its name in the configuration, or
    name: NotRequired[str | None]
    # `payload`: by its mass, 0 for nothing, or at least LIGHTEST_KG [kg]
    mass: NotRequired[float | None]
    # `payload`: beside `mass`: its centre in the hand's frame, three numbers [m]
    com: NotRequired[list[float] | None]
