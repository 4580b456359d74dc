"""Messages of the control socket: requests, replies, and one `State` per tick.

Everything is JSON. Numbers keep every bit on the way (shortest round-trip representation), so a
recording can be replayed bit-identically. Vectors have one entry per joint, in the order of
`Snapshot.joints`, SI units at the link side.
"""

from typing import Annotated, Any, Literal, get_args

import msgspec

from daemon.modes.table import Mode
from estimator.payload import Payload

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
# Commands that are served before all others, and what must not be carried out any more if it came
# before them, or with them, and still waits for its turn.
OUTDATED_BY: dict[Command, frozenset[Command]] = {
    "stop": AWAITED,
    "disarm": frozenset({"arm"}),
}

PerJoint = list[float]
"""One number per joint, in the order of `Snapshot.joints`, SI at the link side."""

SideName = Literal["left", "gap", "right", "unknown"]
"""Gap state of a joint: `motor_position.Side` in words."""

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
    """`text` as it may stand in `Request.on_behalf_of`: a question mark for each other character,
    and no more of it than there is room for."""
    plain = "".join(c if " " <= c <= "~" and c not in '"\\' else "?" for c in text)
    return plain[:MOST_ON_BEHALF]


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
    rows: list[list[float]] | None = None  # `load`: more of it
    loaded: bool = False  # `start`: run what this connection has loaded
    # `arm`, `renew`: for how long from now, unless renewed; 0.5 s, or 600 s if detached.
    lease_s: Annotated[float, msgspec.Meta(gt=0, le=86_400)] | None = None
    # `arm`: the lease outlives this connection, and any process of this user may arm again.
    detached: bool = False
    joint: str | None = None  # `gain`: of which joint
    gain: float | None = None  # `gain`: its K_a from now on [rad/s per Nm]
    # Who asked the client for this, in its own words: for the log, and believed by nobody.
    on_behalf_of: (
        Annotated[str, msgspec.Meta(min_length=1, max_length=MOST_ON_BEHALF, pattern=PLAIN)] | None
    ) = None
    # `payload`: what the hand carries from now on, by its name in the configuration, or
    name: str | None = None
    mass: float | None = None  # by its mass [kg]; 0: nothing
    com: list[float] | None = None  # beside `mass`: its centre in the hand's frame [m]
    pose: Annotated[str, msgspec.Meta(max_length=64)] | None = None  # `go`: to this one, or
    # to these positions; joints that are not named stay [rad]
    targets: Annotated[dict[str, float], msgspec.Meta(max_length=32)] | None = None
    # `go`: of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: Annotated[float, msgspec.Meta(gt=0, le=2)] | None = None
    plan: bool = False  # `go`: answer only what it would do
    # `go`: positions for which it was planned; refused if the arm stands elsewhere by now [rad]
    planned_from: Annotated[list[float], msgspec.Meta(max_length=32)] | None = None
    # `go`, `start` of what was loaded: halt when this connection ends, or asks nothing for 2 s
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
    on_behalf_of: str = ""  # as the owner said


class ToolForce(msgspec.Struct, frozen=True, kw_only=True):
    """Forces at the tool that the arm feels; directions along x, y, z of the URDF's root."""

    least_N: float  # where it feels best
    least_along: list[float]
    most_N: float  # where it feels worst, beside where it feels nothing
    most_along: list[float]
    unfelt: list[list[float]] = []  # directions in which no joint feels a force


class Felt(msgspec.Struct, frozen=True, kw_only=True):
    """Touches that the arm feels in its present pose: torque at each joint, force at the tool. Both
    may be a little larger before they are felt, by errors of the model (docs/estimator.md)."""

    joints: list[str]
    tool: str  # the point, in words
    # None: a joint that does not sense now, and feels nothing
    moving: list[float | None]  # [Nm], every joint at its velocity limit
    resting: list[float | None]  # [Nm], every joint at rest
    tool_moving: ToolForce
    tool_resting: ToolForce


class Way(msgspec.Struct, frozen=True, kw_only=True):
    """Way to a pose: a straight line through joint space, which knows nothing of what stands in
    it. All joints arrive together."""

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
    felt: Felt | None = None  # of `arm` that is done; a client that does not know it leaves it out
    row: int | None = None  # of a trajectory: the first that was refused, from 0
    unproved: list[str] = []  # joints that are told to stop and not seen to stand
    # of `start` and `go` that are done, and of a plan: beyond what the thresholds have seen, or
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
    """Record of one tick: everything it measured, estimated and decided."""

    tick: int
    time_s: float  # time of the tick since the loop started
    interval_s: float  # since the tick before
    mode: Mode
    armed: bool
    cause: str  # why this mode, in words
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
    unproved: list[str] = []  # joints that were told to stop and not seen to stand
    silenced: bool = False  # the drives hear nothing of the daemon until `reset`
    sensing: list[bool] | None = None  # joints that sense contact now; None in format 1
    sensing_since_s: PerJoint | None = None  # time at which that last changed [s]
    # k: share of each configured contact level that learning leaves in force; None where recorded
    # before it was said
    level_share: PerJoint | None = None
    permit: Permit | None = None  # while armed; None also in recordings from before it was told
    payload: Payload | None = None  # that the model counts in this tick
    recognised: Payload | None = None  # that nobody told; nothing is learned in this tick


STATE_FORMAT = 5
"""Version of State and Snapshot. It rises when a field changes its name or its meaning; a new field
with a default needs no new version. Recordings of every version from 1 on stay readable."""


def format_refusal(version: int) -> str:
    """Reason why States of this version are not read; empty where they are."""
    if version < 1:
        return "of a contactd before format 1, whose States have other fields: record anew"
    if version > STATE_FORMAT:
        return f"of format {version}; this contactd reads up to {STATE_FORMAT}: use a newer one"
    return ""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """Context of a recording: all that is needed to read its States. Sent to each reader first."""

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
    """One part of the real-time set-up, granted by the machine or not, and the same in words."""

    name: str
    achieved: bool
    text: str


class Trajectory(msgspec.Struct, frozen=True, kw_only=True):
    """The trajectory that runs, is interrupted, or would be run by `start`."""

    name: str  # empty where none is configured: `start` needs a file then
    state: Literal["ready", "running", "interrupted", "paused"]
    time_s: float  # path time
    duration_s: float | None  # None: it has no end


class Learned(msgspec.Struct, frozen=True, kw_only=True):
    """What was learned since identification, as shares of what was identified: +0.1 is a tenth
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
    realtime: list[Grant]  # what was achieved of the real-time set-up, and what not
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
    unproved: list[str] = []  # joints that were told to stop and not seen to stand
    silenced: bool = False  # the drives hear nothing of the daemon until `reset`
    felt: Felt | None = None  # None before the first samples
    sensing: list[bool] | None = None  # joints that sense contact now; None before the first tick
    sensing_since_s: PerJoint | None = None  # when that last changed, as `uptime_s` counts
    lost: PerJoint | None = None  # share of the samples of late that went missing
    learned: Learned | None = None  # None where nothing is learned
    hand: str = ""  # the URDF's last link, in whose frame payloads are
    payload: Payload | None = (
        None  # that was announced since the start, and is forgotten at its end
    )
    payloads: list[Payload] = []  # that can be announced by name
    poses: dict[str, dict[str, float]] = {}  # that `go` can be asked for: joints by name [rad]
    gears: list[str] = []  # what their trends say, a line for each joint (`contactctl health`)
    recognised: str = ""  # load that nobody told, in words, with what to do; empty without one
    # Files that say something else than those it runs by; looked at while the drives are off.
    changed: list[str] = []
    not_taken_up: str = ""  # why a `reload` went on with the old ones, with file and field
