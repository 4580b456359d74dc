"""Requests of the control socket: one struct per command, with the arguments that it takes.

JSON objects, distinguished by `command`. Fields that a command does not take are refused, as are
unknown ones.
"""

from typing import Annotated, Any, Final, Literal, get_args

import msgspec

from daemon.protocol.bounds import FASTEST, MAX_GAIN, PLAUSIBLE, SLOWEST
from daemon.protocol.guide import GuideAxes
from daemon.protocol.lease import LONGEST_S, SHORTEST_S
from daemon.protocol.text import MOST_ON_BEHALF, ONE_LINE, PLAIN
from estimator.payload import FURTHEST_M, HEAVIEST_KG, THINNEST_M

MAX_REQUEST_BYTES: Final = 8192  # of one message to the daemon


def _within(least: float, most: float) -> msgspec.Meta:
    """Bounds for the JSON schema only: such numbers are checked where joint and row are known."""
    return msgspec.Meta(extra_json_schema={"minimum": least, "maximum": most})


Plausible = Annotated[float, _within(-PLAUSIBLE, PLAUSIBLE)]
Pose = Annotated[list[Plausible], msgspec.Meta(max_length=32)]
Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
LeaseS = Annotated[float, msgspec.Meta(ge=SHORTEST_S, le=LONGEST_S)]


class Header(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Header of a trajectory, whose rows are [t, q of each joint, q_dot of each joint]."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=64, pattern=ONE_LINE)]
    joints: Annotated[list[str], msgspec.Meta(max_length=32)]  # all others hold
    from_here: bool = False  # run as displacements from any pose
    motors_only: bool = False  # by the motors' velocity alone, with no loop over the links


class _Bare(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True,
    tag_field="command",
):  # fmt: skip
    """Base of all requests, with their common fields."""

    # Person or program on whose behalf the client asks, as stated by the client: for the log only,
    # not verified.
    on_behalf_of: (
        Annotated[str, msgspec.Meta(min_length=1, max_length=MOST_ON_BEHALF, pattern=PLAIN)] | None
    ) = None

    @property
    def command(self) -> "Command":
        """Name of the command."""
        name: Command = self.__struct_config__.tag  # type: ignore[assignment]
        return name


class Enable(_Bare, frozen=True, tag="enable"):
    """Energise the drives and hold."""


class Load(_Bare, frozen=True, tag="load"):
    """Begin a trajectory, or append to it."""

    header: Header | None = None  # begins a new one
    rows: list[list[Plausible]] | None = None  # rows to append


class Start(_Bare, frozen=True, tag="start"):
    """Run the configured trajectory, or continue the paused one."""

    loaded: bool = False  # run the trajectory that this connection has loaded
    # the loaded one halts and is forgotten when this connection ends, or sends nothing for 2 s
    attended: bool = False


class Go(_Bare, frozen=True, tag="go"):
    """Move on a straight line through joint space, to a pose or to targets."""

    pose: Annotated[str, msgspec.Meta(max_length=64)] | None = None  # to this one, or
    # to these positions, within the joints' limits; joints that are not named stay [rad]
    targets: Annotated[dict[str, Plausible], msgspec.Meta(max_length=32)] | None = None
    # of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: Annotated[float, msgspec.Meta(ge=SLOWEST, le=FASTEST)] | None = None
    plan: bool = False  # only answer with the planned motion
    # positions from which it was planned; refused if the arm has moved since [rad]
    planned_from: Pose | None = None
    # the motion halts and is forgotten when this connection ends, or sends nothing for 2 s
    attended: bool = False


class Follow(_Bare, frozen=True, tag="follow"):
    """Follow a stream of targets, of which this is the first; or rejoin it after a contact."""

    q: Pose  # of all joints [rad]
    sent_s: Plausible  # time of the sender's monotonic clock [s]
    number: Count = 0  # the sender's count of its targets


class Target(_Bare, frozen=True, tag="target"):
    """Next target of the stream that this connection began."""

    q: Pose  # of all joints [rad]
    sent_s: Plausible  # as in `follow` [s]
    number: Count  # as in `follow`
    velocity: Pose | None = None  # of all joints [rad/s]; computed from the targets unless given


class Pause(_Bare, frozen=True, tag="pause"):
    """Halt the trajectory where it is."""


class Arm(_Bare, frozen=True, tag="arm"):
    """Let the arm yield to contact while the lease lasts."""

    lease_s: LeaseS | None = None  # from now, unless renewed; 0.5 s, or 600 s if detached
    # the lease outlives this connection, and any process of this user may arm again
    detached: bool = False


class Renew(_Bare, frozen=True, tag="renew"):
    """Extend the lease of this connection."""

    lease_s: LeaseS | None = None  # from now; 0.5 s unless given


class Disarm(_Bare, frozen=True, tag="disarm"):
    """Stop yielding to contact."""


class Stop(_Bare, frozen=True, tag="stop"):
    """Stop the arm, and hold."""


class Disable(_Bare, frozen=True, tag="disable"):
    """Stop, and switch the drives off."""


class Reset(_Bare, frozen=True, tag="reset"):
    """Clear a fault whose cause is gone."""


class SetGain(_Bare, frozen=True, tag="gain"):
    """Set the gain of (15) of one joint."""

    joint: str
    # K_a from now on, 0 or at least LEAST_GAIN [rad/s per Nm]
    gain: Annotated[float, _within(0.0, MAX_GAIN)]


class SetGuide(_Bare, frozen=True, tag="guide"):
    """Set the guide, which begins where the arm is led next; without axes, remove it."""

    axes: GuideAxes = GuideAxes()


class SetPayload(_Bare, frozen=True, tag="payload"):
    """Announce the payload of the hand."""

    name: str | None = None  # by its name in the configuration, or
    # by its mass, 0 for nothing, or at least LIGHTEST_KG [kg]
    mass: Annotated[float, _within(0.0, HEAVIEST_KG)] | None = None
    # with `mass`: its centre in the hand's frame, three numbers [m]
    com: list[Annotated[float, _within(-FURTHEST_M, FURTHEST_M)]] | None = None
    # edges of a box about that centre, along the hand's axes, three numbers [m]
    box: list[Annotated[float, _within(THINNEST_M, FURTHEST_M)]] | None = None


class Reload(_Bare, frozen=True, tag="reload"):
    """Load changed files while the drives are off."""


class GetStatus(_Bare, frozen=True, tag="status"):
    """Request the Status."""


class Subscribe(_Bare, frozen=True, tag="subscribe"):
    """Request a State in each tick."""


Request = (
    Enable | Load | Start | Go | Follow | Target | Pause | Arm | Renew | Disarm | Stop | Disable
    | Reset | SetGain | SetGuide | SetPayload | Reload | GetStatus | Subscribe
)  # fmt: skip
ModeRequest = Enable | Pause | Disarm | Stop | Disable | Reset
"""Requests for an event of the table of modes, without arguments."""
Command = Literal[
    "enable", "load", "start", "go", "follow", "target", "pause", "arm", "renew", "disarm", "stop",
    "disable", "reset", "gain", "guide", "payload", "reload", "status", "subscribe",
]  # fmt: skip
COMMANDS: Final[tuple[Command, ...]] = get_args(Command)
KINDS: Final[dict[Command, type[Any]]] = dict(zip(COMMANDS, get_args(Request), strict=True))

# Commands that let the arm move: dropped if the client closes the connection before the answer.
AWAITED: Final[frozenset[Command]] = frozenset({"enable", "start", "go", "follow", "target", "arm"})
# Commands that the view socket takes: none that lets the arm move.
VIEWED: Final[frozenset[Command]] = frozenset({"subscribe", "status", "stop", "disarm"})
# Commands still served while the daemon is ending: none that moves or energises the arm.
AT_THE_END: Final[frozenset[Command]] = VIEWED | {"disable"}
# Commands that reduce motion: one that failed must not leave the arm moving.
STILLING: Final[frozenset[Command]] = frozenset({"pause", "disarm", "stop", "disable"})
# Commands whose reply lists joints not confirmed at standstill.
SEEN_TO_STAND: Final[frozenset[Command]] = frozenset({"disarm", "stop", "disable", "reset"})
# Commands that are served before all others, with the waiting commands that each cancels.
OUTDATED_BY: Final[dict[Command, frozenset[Command]]] = {
    "stop": AWAITED,
    "disarm": frozenset({"arm"}),
}


def bare(command: Command, on_behalf_of: str | None = None) -> Request:
    """Request of a command without its optional arguments."""
    request: Request = KINDS[command](on_behalf_of=on_behalf_of)
    return request


def fields_of(command: Command) -> tuple[str, ...]:
    """Names of the arguments of a command, `on_behalf_of` last."""
    own = KINDS[command].__struct_fields__
    return (*(name for name in own if name != "on_behalf_of"), "on_behalf_of")
