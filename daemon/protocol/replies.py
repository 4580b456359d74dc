"""Replies of the control socket to requests, and the Status of the daemon. JSON, as `state`."""

from typing import Literal

import msgspec

from daemon.modes.table import Mode
from daemon.protocol.guide import GuideAxes
from daemon.protocol.state import Near, PerJoint, Permit, SideName, Snapshot, StreamState, Wrench
from estimator.payload import Payload


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """Arming check, with the reason why it passed or failed."""

    name: str
    passed: bool
    text: str

    def __str__(self) -> str:
        return f"{'passed' if self.passed else 'failed'}  {self.name:15} {self.text}"


class ToolForce(msgspec.Struct, frozen=True, kw_only=True):
    """Smallest detected forces at the tool; directions along x, y, z of the URDF's root."""

    least_N: float  # in the most sensitive direction
    least_along: list[float]
    most_N: float  # in the least sensitive direction, except those without detection
    most_along: list[float]
    undetected: list[list[float]] = []  # directions in which no joint detects a force


class Sensitivity(msgspec.Struct, frozen=True, kw_only=True):
    """Smallest contacts that the arm detects in its present pose: torque at each joint, force at
    the tool. With model errors both may be a little larger (docs/estimator.md)."""

    joints: list[str]
    tool: str  # description of the tool point
    # None: a joint that does not sense now, and detects nothing
    moving: list[float | None]  # [Nm], every joint at its velocity limit
    resting: list[float | None]  # [Nm], every joint at rest
    tool_moving: ToolForce
    tool_resting: ToolForce


class PlannedPath(msgspec.Struct, frozen=True, kw_only=True):
    """Path to a pose: a straight line through joint space, on which all joints arrive together."""

    name: str
    joints: list[str]
    start: PerJoint  # [rad]
    goal: PerJoint  # [rad]
    speed: PerJoint  # largest on the path [rad/s]
    duration_s: float  # from standstill to standstill, without a contact
    shapes: bool = False  # it is checked against the shapes of the arm and its surroundings


class Reply(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Answer to one `Request`: done or refused, with every reason for a refusal."""

    ok: bool
    message: str = ""
    reasons: list[str] = []
    mode: Mode | None = None
    armed: bool = False
    checks: list[Check] = []  # of `arm`
    sensitivity: Sensitivity | None = None  # of a successful `arm`
    row: int | None = None  # first refused row of a trajectory, from 0
    unproved: list[str] = []  # joints commanded to stop and not confirmed at standstill
    # of a successful `start` or `go`, and of a plan: motion that the thresholds do not cover, or
    # that ends nearer to a limit than a joint may get
    warnings: list[str] = []
    way: PlannedPath | None = None  # of a successful or planned `go`
    stream: StreamState | None = None  # of `follow` and `target`
    status: "Status | None" = None
    snapshot: "Snapshot | None" = None

    @property
    def refusal(self) -> str:
        """The message and every reason of a refusal, in one line."""
        return "; ".join([self.message or "refused", *self.reasons])


class Grant(msgspec.Struct, frozen=True):
    """One part of the real-time set-up, granted by the machine or not, with its description."""

    name: str
    achieved: bool
    text: str


class Trajectory(msgspec.Struct, frozen=True, kw_only=True):
    """Trajectory that runs, is interrupted, or would be run by `start`."""

    name: str  # empty if none is configured: `start` then needs a file
    state: Literal["ready", "running", "interrupted", "paused"]
    time_s: float  # path time
    duration_s: float | None  # None: endless
    attended: bool = False  # it halts and is forgotten when the program that began it ends


class Learned(msgspec.Struct, frozen=True, kw_only=True):
    """Friction learned since identification. Coulomb and viscous are changes, as shares of the
    identified values: +0.1 is a tenth more. Load is friction per torque that the gear transmits."""

    coulomb: PerJoint
    viscous: PerJoint
    load: PerJoint


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """Status of the daemon, as `contactctl status` shows it."""

    name: str
    configuration: str  # absolute path
    pid: int
    uptime_s: float
    mode: Mode
    armed: bool
    permit: Permit | None  # while armed
    disarmed: str = ""  # cause of the last disarming; empty before one
    disarmed_s: float = 0.0  # when that was, as `uptime_s` counts
    cause: str
    since_s: float | None = None  # when `cause` led to this mode, as `uptime_s` counts
    advice: str = ""  # what to do about the cause, if that is a fault
    trajectory: Trajectory
    stream: StreamState | None = None  # while the trajectory is one
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
    contact: PerJoint = []  # configured contact levels [Nm]
    least: PerJoint = []  # lowest contact levels that learning may set [Nm]
    level_share: PerJoint = []  # k: share of the contact levels that learning leaves now
    side: list[SideName]
    gain: PerJoint  # K_a, at the end of its ramp [rad/s per Nm]
    age_ticks: list[int]
    serials: list[int | None] = []  # 0x1018:4 of the drives
    unproved: list[str] = []  # joints commanded to stop and not confirmed at standstill
    silenced: bool = False  # the daemon sends nothing to the drives until `reset`
    sensitivity: Sensitivity | None = None  # None before the first samples
    sensing: list[bool] | None = None  # joints that sense contact now; None before the first tick
    sensing_since_s: PerJoint | None = None  # when that last changed, as `uptime_s` counts
    lost: PerJoint | None = None  # share of recent samples that went missing
    learned: Learned | None = None  # None if learning is off
    hand: str = ""  # the URDF's last link, in whose frame payloads are
    payload: Payload | None = None  # announced since the start, and forgotten at its end
    payloads: list[Payload] = []  # that can be announced by name
    poses: dict[str, dict[str, float]] = {}  # poses for `go`, by name: positions by joint [rad]
    gears: list[str] = []  # findings of their trends, a line for each joint (`contactctl health`)
    recognised: str = ""  # description of an unannounced payload, with advice; empty without one
    guide: GuideAxes = GuideAxes()  # of an arm that is led by hand
    wrench: Wrench | None = None  # force at the tool; None in a mode without contact sensing
    wrench_at: str = ""  # description of its point
    wrench_axes: str = ""  # link of the URDF along whose axes it is
    near: Near | None = None  # None without shapes, or in a mode in which the arm does not move
    unguarded: str = ""  # reason why no shape is guarded in this run, although the arm has some
    changed: list[str] = []  # files that differ from those in use; checked while off
    not_taken_up: str = ""  # reason why a `reload` kept the previous files, with file and field
