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
    from_here: NotRequired[bool]  # may begin from any pose, run as displacements
    motors_only: NotRequired[bool]  # by the motors' velocity alone, whatever the links do


class GuideAxes(TypedDict):
    """Directions of a guide; those that are not named are free, and with none there is no guide."""

    # the tool with its axes or, `base`, with those of the URDF's root; or a link, by its origin
    frame: NotRequired[str]
    free: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    damped: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]  # at a fifth of the speed
    held: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    # held, and taken back to where the guide began
    stiff: NotRequired[list[Literal["rx", "ry", "rz", "x", "y", "z"]]]
    redundant: NotRequired[Literal["free", "held"]]  # joints that can move where the frame stands


class Request(TypedDict):
    """One command, with the arguments that only some commands take."""

    command: Command
    # Person or program on whose behalf the client asks, as stated by the client: for the log only,
    # not verified.
    on_behalf_of: NotRequired[str | None]
    header: NotRequired[Header | None]  # `load`: begins one
    rows: NotRequired[list[list[float]] | None]  # `load`: more of it
    loaded: NotRequired[bool]  # `start`: run what this connection has loaded
    # `start`, `go`: it halts when this connection ends, or sends nothing for 2 s, and is forgotten
    attended: NotRequired[bool]
    pose: NotRequired[str | None]  # `go`: to this one, or
    # `go`: to these positions, within the joints' limits; joints that are not named stay [rad]
    targets: NotRequired[dict[str, float] | None]
    # `go`: of the joint that goes furthest; 0.2 unless given [rad/s]
    speed: NotRequired[float | None]
    plan: NotRequired[bool]  # `go`: answer only what it would do
    # `go`: positions for which it was planned; refused if the arm is elsewhere by now [rad]
    planned_from: NotRequired[list[float] | None]
    q: NotRequired[list[float]]  # `follow`, `target`: of all joints [rad]
    sent_s: NotRequired[float]  # `follow`, `target`: as in `follow` [s]
    number: NotRequired[int]  # `follow`, `target`: as in `follow`
    # `target`: of all joints [rad/s]; measured from the targets unless given
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
    # `payload`: beside `mass`: its centre in the hand's frame, three numbers [m]
    com: NotRequired[list[float] | None]
    # `payload`: edges of a box about that centre, along the hand's axes, three numbers [m]
    box: NotRequired[list[float] | None]
