"""Messages of the control socket: requests, replies, and one `State` per tick.

Everything is JSON. Numbers keep every bit on the way (shortest round-trip representation), so a
recording can be replayed bit-identically. Vectors have one entry per joint, in the order of
`Snapshot.joints`, SI units at the link side.
"""

from typing import Annotated, Any, Literal, get_args

import msgspec

from daemon.modes.table import Mode
from daemon.protocol.bounds import (
    FASTEST,
    MAX_GAIN,
    PLAUSIBLE,
    SLOWEST,
)
from daemon.protocol.lease import LONGEST_S, SHORTEST_S
from estimator.payload import FURTHEST_M, HEAVIEST_KG, Payload

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
COMMANDS: tuple[str, ...] = get_args(Command)
MAX_REQUEST_BYTES = 8192  # of one message to the daemon
# Commands that let the arm move: dropped if the client closed the connection before the answer.
AWAITED: frozenset[Command] = frozenset({"enable", "start", "go", "arm"})
# Commands that are served before all others, and those that must not be carried out any more if
# they came before them, or with them, and still wait for their turn.
OUTDATED_BY: dict[Command, frozenset[Command]] = {
    "stop": AWAITED,
    "disarm": frozenset({"arm"}),
}

PerJoint = list[float]
"""One number per joint, in the order of `Snapshot.joints`, SI at the link side."""

SideName = Literal["left", "gap", "right", "unknown"]
"""Gap state of a joint: name of `motor_position.Side`."""

# Text that may stand in one line of the log: no line breaks, no control characters for a terminal
# (C0, C1), none that reverse the text beside them (bidirectional embeddings and isolates).
ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]*\Z"


# Printable ASCII that JSON writes as it is: a stop with such a text in it is still a short packet.
PLAIN = r"^[ !#-\[\]-~]*\Z"
MOST_ON_BEHALF = 64  # characters


def printable(text: str) -> str:
    """`text` with a question mark for each character that cannot be printed: names and contents of
    files may hold any. The result matches ONE_LINE."""
    return "".join(character if character.isprintable() else "?" for character in text)


def on_behalf_of(text: str) -> str:
    """`text` as allowed in `Request.on_behalf_of`: a question mark for each other character, and
    cut to the allowed length."""
    plain = "".join(c if " " <= c <= "~" and c not in '"\\' else "?" for c in text)
    return plain[:MOST_ON_BEHALF]


def _within(least: float, most: float) -> msgspec.Meta:
    """Bounds for the schema, of numbers that are checked where joint and row are known."""
    return msgspec.Meta(extra_json_schema={"minimum": least, "maximum": most})


Plausible = Annotated[float, _within(-PLAUSIBLE, PLAUSIBLE)]


class Header(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Header of a trajectory, whose rows are [t, q of each joint, q_dot of each joint]."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern=ONE_LINE)]
    joints: Annotated[list[str], msgspec.Meta(max_length=32)]  # all others hold
    from_here: bool = False  # may begin from any pose, run as displacements
    motors_only: bool = False  # by the motors' velocity alone, whatever the links do


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One command from a client, with the arguments that only some commands take."""

    command: Command
    header: Header | None = None  # `load`: begin a trajectory
    rows: list[list[Plausible]] | None = None  # `load`: more of it
    loaded: bool = False  # `start`: run what this connection has loaded
    # `arm`, `renew`: for how long from now, unless renewed; 0.5 s, or 600 s if detached.
    lease_s: Annotated[float, msgspec.Meta(ge=SHORTEST_S, le=LONGEST_S)] | None = None
    # `arm`: the lease outlives this connection, and any process of this user may arm again.
    detached: bool = False
    joint: str | None = None  # `gain`: of which joint
    # `gain`: its K_a from now on, 0 or at least LEAST_GAIN [rad/s per Nm]
    gain: Annotated[float, _within(0.0, MAX_GAIN)] | None = None
    # Person or program on whose behalf the client asks, as stated by the client: for the log only,
    # not verified.
    on_behalf_of: (
        Annotated[str, msgspec.Meta(min_length=1, max_length=MOST_ON_BEHALF, pattern=PLAIN)] | None
    ) = None
    # `payload`: payload of the hand from now on, by its name in the configuration, or
    name: str | None = None
    # by its mass, 0 for nothing, or at least LIGHTEST_KG [kg]
    mass: Annotated[float, _within(0.0, HEAVIEST_KG)] | None = None
    # beside `mass`: its centre in the hand's frame, three numbers [m]
    com: list[Annotated[float, _within(-FURTHEST_M, FURTHEST_M)]] | None = None
    pose: Annotated[str, msgspec.Meta(max_length=64)] | None = None  # `go`: to this one, or
    # to these positions, within the joints' limits; joints that are not named stay [rad]
    targets: Annotated[dict[str, Plausible], msgspec.Meta(max_length=32)] | None = None
    # `go`: of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: Annotated[float, msgspec.Meta(ge=SLOWEST, le=FASTEST)] | None = None
    plan: bool = False  # `go`: answer only what it would do
    # `go`: positions for which it was planned; refused if the arm is elsewhere by now [rad]
    planned_from: Annotated[list[Plausible], msgspec.Meta(max_length=32)] | None = None
    # `go`, `start` of a loaded trajectory: halt when this connection ends, or sends nothing for
    # 2 s, and forget the motion
    attended: bool = False


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """One check before the arm may be armed, with the reason why it passed or failed."""

    name: str
    passed: bool
    text: str

    def __str__(self) -> str:
        return f"{'passed' if self.passed else 'failed'}  {self.name:15} {self.text}"


class Permit(msgspec.Struct, frozen=True, kw_only=True):
    """Owner of the lease on the armed arm, and the time it has left."""

    uid: int
    pid: int
    detached: bool  # ends by time alone; otherwise also with the connection of `pid`
    left_s: float
    on_behalf_of: str = ""  # as stated by the owner


class ToolForce(msgspec.Struct, frozen=True, kw_only=True):
    """Forces at the tool that the arm detects; directions along x, y, z of the URDF's root."""

    least_N: float  # in the most sensitive direction
    least_along: list[float]
    most_N: float  # in the least sensitive direction, except those without detection
    most_along: list[float]
    undetected: list[list[float]] = []  # directions in which no joint detects a force


class Sensitivity(msgspec.Struct, frozen=True, kw_only=True):
    """Smallest touches that the arm detects in its present pose: torque at each joint, force at the
    tool. With errors of the model both may be a little larger (docs/estimator.md)."""

    joints: list[str]
    tool: str  # description of the tool point
    # None: a joint that does not sense now, and detects nothing
    moving: list[float | None]  # [Nm], every joint at its velocity limit
    resting: list[float | None]  # [Nm], every joint at rest
    tool_moving: ToolForce
    tool_resting: ToolForce


class Way(msgspec.Struct, frozen=True, kw_only=True):
    """Way to a pose: a straight line through joint space, on which all joints arrive together.
    Obstacles are not taken into account."""

    name: str
    joints: list[str]
    start: PerJoint  # [rad]
    goal: PerJoint  # [rad]
    speed: PerJoint  # largest on the way [rad/s]
    duration_s: float  # from standstill to standstill, unless a contact comes in between


class Reply(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Answer to one `Request`: done or refused, with every reason for a refusal."""

    ok: bool
    message: str = ""
    reasons: list[str] = []
    mode: Mode | None = None
    armed: bool = False
    checks: list[Check] = []  # of `arm`
    sensitivity: Sensitivity | None = None  # of `arm` that is done
    row: int | None = None  # of a trajectory: the first that was refused, from 0
    unproved: list[str] = []  # joints commanded to stop and not confirmed at standstill
    # of `start` and `go` that are done, and of a plan: beyond what the thresholds cover, or
    # nearer to a limit than a joint may get
    warnings: list[str] = []
    way: Way | None = None  # of `go` that is done, or planned
    status: "Status | None" = None
    snapshot: "Snapshot | None" = None

    @property
    def refusal(self) -> str:
        """The message and every reason of a refusal, in one line."""
        return "; ".join([self.message or "refused", *self.reasons])


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """Contact: the residual of a joint passed one of its levels."""

    joint: str
    torque: float  # the residual, signed [Nm]
    threshold: float  # the level it passed [Nm]
    level: Literal["contact", "collision"]
    side: SideName


class Notice(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Event of one tick: a change of mode or permission, a contact, or a fault."""

    kind: Literal["mode", "contact", "fault"]
    text: str
    contact: Contact | None = None


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """Timing of the loop: the only fields of a State that differ between two lockstep runs with one
    seed."""

    wall_s: float  # Unix time of the tick
    monotonic_s: float  # CLOCK_MONOTONIC of the wake-up
    lateness_us: float  # wake-up after the deadline
    work_us: float  # from the wake-up to the last frame sent, in the tick before this one
    missed: int  # deadlines missed since the start
    doors_us: float = 0.0  # spent on clients and the log, after the tick before this one


class State(msgspec.Struct, frozen=True, kw_only=True):
    """Record of one tick: its measurements, estimates and decisions."""

    tick: int
    time_s: float  # time of the tick since the loop started
    interval_s: float  # since the tick before
    mode: Mode
    armed: bool
    cause: str  # reason for this mode
    moving: bool  # a trajectory is running or will go on after this contact
    fresh: list[bool]  # joints whose samples came in time; of others these are the last
    drives: list[str]  # CiA 402 states
    # measured, input of the estimator
    current: PerJoint  # [A]
    link_position: PerJoint  # q [rad]
    motor_velocity: PerJoint  # theta_dot [rad/s]
    motor_position: PerJoint | None  # theta [rad], where the drive has it
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
    touched_link: str  # named by its joint; empty: no contact, or its link is not known
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


STATE_FORMAT = 6
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


class Grant(msgspec.Struct, frozen=True):
    """One part of the real-time set-up, granted by the machine or not, with its description."""

    name: str
    achieved: bool
    text: str


class Trajectory(msgspec.Struct, frozen=True, kw_only=True):
    """The trajectory that runs, is interrupted, or would be run by `start`."""

    name: str  # empty where none is configured: `start` needs a file then
    state: Literal["ready", "running", "interrupted", "paused"]
    time_s: float  # path time
    duration_s: float | None  # None: it has no end
    attended: bool = False  # it halts, and is forgotten, when the program that began it ends


class Learned(msgspec.Struct, frozen=True, kw_only=True):
    """Changes learned since identification, as shares of the identified values: +0.1 is a tenth
    more."""

    coulomb: PerJoint
    viscous: PerJoint


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """Status of the daemon, as `contactctl status` shows it."""

    name: str
    configuration: str  # absolute path
    pid: int
    uptime_s: float
    mode: Mode
    armed: bool
    permit: Permit | None  # while armed
    cause: str
    since_s: float | None = None  # when that led to this mode, as `uptime_s` counts
    advice: str = ""  # what to do about the cause, if that is a fault
    trajectory: Trajectory
    checks: list[Check]  # what arming needs
    ticks: int
    missed: int
    lateness_max_us: float
    work_max_us: float
    realtime: list[Grant]  # parts of the real-time set-up, achieved or not
    readers: int
    joints: list[str]
    identities: list[str] = []  # of the drives: make, revision, serial number
    drives: list[str]
    link_position: PerJoint
    residual: PerJoint
    threshold: PerJoint
    side: list[SideName]
    gain: PerJoint  # K_a, as it is or is about to be [rad/s per Nm]
    age_ticks: list[int]
    serials: list[int | None] = []  # 0x1018:4 of the drives
    unproved: list[str] = []  # joints commanded to stop and not confirmed at standstill
    silenced: bool = False  # the daemon sends nothing to the drives until `reset`
    sensitivity: Sensitivity | None = None  # None before the first samples
    sensing: list[bool] | None = None  # joints that sense contact now; None before the first tick
    sensing_since_s: PerJoint | None = None  # when that last changed, as `uptime_s` counts
    lost: PerJoint | None = None  # share of recent samples that went missing
    learned: Learned | None = None  # None where nothing is learned
    hand: str = ""  # the URDF's last link, in whose frame payloads are
    payload: Payload | None = (
        None  # that was announced since the start, and is forgotten at its end
    )
    payloads: list[Payload] = []  # that can be announced by name
    poses: dict[str, dict[str, float]] = {}  # that `go` can be asked for: joints by name [rad]
    gears: list[str] = []  # findings of their trends, a line for each joint (`contactctl health`)
    recognised: str = ""  # description of an unannounced payload, with advice; empty without one
    # Files that differ from those in use; checked while the drives are off.
    changed: list[str] = []
    not_taken_up: str = ""  # reason why a `reload` kept the old ones, with file and field
