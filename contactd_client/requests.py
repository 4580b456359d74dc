"""Requests to the daemon's sockets, as the dictionaries that JSON makes.

Made from the code by `make reference`: change them in `daemon/protocol/`.
"""

from typing import Literal, NotRequired, TypedDict

Command = Literal[
    "enable", "load", "start", "go", "follow", "target", "pause", "arm", "renew", "disarm", "stop",
    "disable", "reset", "gain", "guide", "payload", "reload", "status", "subscribe",
]  # fmt: skip


class Header(TypedDict):
    """Header of a trajectory, whose rows are [t, q of each joint, q_dot of each joint]."""

    name: str
    joints: list[str]  # all others hold
    from_here: NotRequired[bool]  # run as displacements from any pose
    motors_only: NotRequired[bool]  # by the motors' velocity alone, with no loop over the links


class GuideAxes(TypedDict):
    """Axes of a guide; those not named are free, and if all are free there is no guide."""

    # the tool in its own axes or (`base`) in those of the URDF's root; or a link, at its origin
    frame: NotRequired[str]
    free: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    damped: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]  # at a fifth of the speed
    held: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    # held, and returned to where the guide began
    stiff: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    redundant: NotRequired[Literal["free", "held"]]  # joint motion that leaves the frame at rest


class Request(TypedDict):
    """One command, with the arguments that only some commands take."""

    command: Command
    # Person or program on whose behalf the client asks, as stated by the client: for the log only,
    # not verified.
    on_behalf_of: NotRequired[str | None]
    header: NotRequired[Header | None]  # `load`: begins a new one
    rows: NotRequired[list[list[float]] | None]  # `load`: rows to append
    loaded: NotRequired[bool]  # `start`: run the trajectory that this connection has loaded
    # `start`, `go`: the motion halts and is forgotten when this connection ends, or sends nothing
    # for 2 s
    attended: NotRequired[bool]
    pose: NotRequired[str | None]  # `go`: to this one, or
    # `go`: to these positions, within the joints' limits; joints that are not named stay [rad]
    targets: NotRequired[dict[str, float] | None]
    # `go`: of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: NotRequired[float | None]
    plan: NotRequired[bool]  # `go`: only answer with the planned motion
    # `go`: positions from which it was planned; refused if the arm has moved since [rad]
    planned_from: NotRequired[list[float] | None]
    q: NotRequired[list[float]]  # `follow`, `target`: of all joints [rad]
    sent_s: NotRequired[float]  # `follow`, `target`: as in `follow` [s]
    number: NotRequired[int]  # `follow`, `target`: as in `follow`
    # `target`: of all joints [rad/s]; computed from the targets unless given
    velocity: NotRequired[list[float] | None]
    lease_s: NotRequired[float | None]  # `arm`, `renew`: from now; 0.5 s unless given
    # `arm`: the lease outlives this connection, and any process of this user may arm again
    detached: NotRequired[bool]
    joint: NotRequired[str]  # `gain`
    gain: NotRequired[float]  # `gain`: K_a from now on, 0 or at least LEAST_GAIN [rad/s per Nm]
    axes: NotRequired[GuideAxes]  # `guide`
    name: NotRequired[str | None]  # `payload`: by its name in the configuration, or
    # `payload`: by its mass, 0 for nothing, or at least LIGHTEST_KG [kg]
    mass: NotRequired[float | None]
    # `payload`: with `mass`: its centre in the hand's frame, three numbers [m]
    com: NotRequired[list[float] | None]
    # `payload`: edges of a box about that centre, along the hand's axes, three numbers [m]
    box: NotRequired[list[float] | None]
