"""Texts of one arm on the page, sent as JSON when they change. Pure functions."""

import math
from typing import Any, Literal

import msgspec

from daemon.faults.finding import advice_on
from daemon.modes.table import SENSING, Mode
from daemon.protocol.replies import Check, Learned, Status
from daemon.protocol.state import Meeting, Permit, Snapshot, State, Wrench
from programs.clients.nearest_pair import nearest_pair_words
from programs.clients.sensing import lost_samples
from programs.clients.stream_words import phase_in_words, quality_in_words
from programs.clients.user_names import user_name
from programs.clients.wrench import NO_FIT, bound_N, most_aside_N
from programs.recordings.touch_point import TouchPoint

EventKind = Literal["mode", "contact", "fault", "page"]


class Hello(msgspec.Struct, frozen=True, tag="hello", tag_field="kind"):
    """First message to a browser: names of all arms, and constants of the one it shows. `joints` is
    empty while the daemon cannot be reached."""

    arms: list[str]
    arm: int
    joints: list[str]
    half_gap: list[float]
    period_s: float
    modes: list[str]
    program: str
    bus_load: float | None
    may_command: bool
    may_record: bool
    force_axes: str  # URDF link in whose frame each `Force` is given
    force_point: list[float]  # point in that frame on which it acts [m]
    walls: dict[str, Any] | None  # shapes and surroundings, as in their files
    quiet_s: float  # without contact until the arm continues or holds


class Force(msgspec.Struct, frozen=True):
    """Force at the tool, rounded so that it is not sent more often than a visible change."""

    way: list[float]  # unit vector
    size: float  # [N]
    cone: float  # half-angle of the 95 % confidence cone of its direction [rad]
    text: str


class Touch(msgspec.Struct, frozen=True):
    """Point of contact, rounded likewise."""

    link: str
    point: list[float]  # in the link's frame [m]
    doubt: float  # uncertainty [m]
    text: str


class Load(msgspec.Struct, frozen=True):
    """Load in the hand, announced or only recognised."""

    announced: bool
    mass: float  # [kg]
    com: list[float]  # centre of mass in the frame of the arm's last link [m]
    box: list[float] | None  # edge lengths of a box about it [m]
    text: str


class Words(msgspec.Struct, frozen=True, tag="words", tag_field="kind"):
    """Texts and other rarely changing content of an arm's last State."""

    arm: int
    mode: str
    cause: str
    advice: str  # on that cause, if it is a fault's
    armed: bool
    owner: str
    until_told: bool  # the lease only ends by time; otherwise also with its program
    drives: list[str]
    unproved: list[str]
    silenced: bool
    touched: str
    flags: list[str]
    load: Load | None
    force: Force | None  # None if there is no single force at the tool
    touch: Touch | None  # None if the point is unknown
    stream: str  # phase of the stream of targets; empty without one
    near: str  # closest pair of shapes and surroundings; empty without shapes
    meeting: Meeting | None  # place where the last requested path leads through a shape
    guide: str  # constraint on leading by hand; empty without one


class Summary(msgspec.Struct, frozen=True, tag="summary", tag_field="kind"):
    """Modes of all arms, for the tabs; empty for a daemon that cannot be reached."""

    modes: list[str]
    armed: list[bool]


class Other(msgspec.Struct, frozen=True):
    """Arm of another computer, as in the table of `contactd fleet`."""

    arm: str
    state: str  # alive, gone, or since when silent
    silent: bool
    mode: str
    armed: bool
    level: str
    text: str
    contact: str  # the last one


class Elsewhere(msgspec.Struct, frozen=True, tag="elsewhere", tag_field="kind"):
    """Arms of other computers; `why`: reason why some or all are not shown."""

    why: str
    arms: list[Other]


class Outcome(msgspec.Struct, frozen=True):
    """Outcome of a stop on another computer."""

    outcome: str
    text: str


class Outcomes(msgspec.Struct, frozen=True):
    """Outcomes of stops on other computers, by arm."""

    arms: dict[str, Outcome]


class Advice(msgspec.Struct, frozen=True, tag="advice", tag_field="kind"):
    """Content of the daemon's Status: advice, checks before arming, what was learned."""

    name: str
    advice: str
    checks: list[Check]
    trajectory: str
    stream: str  # quality of the stream of targets; empty without one
    lost: str  # words on lost samples
    learned: Learned | None


class Event(msgspec.Struct, frozen=True):
    """One line of the event log."""

    time_s: float  # loop time
    wall_s: float
    kind: EventKind
    text: str


class Events(msgspec.Struct, frozen=True, tag="events", tag_field="kind"):
    """New lines of the event log, or with `past` the log so far."""

    events: list[Event]
    past: bool = False


class Gone(msgspec.Struct, frozen=True, tag="gone", tag_field="kind"):
    """Message that the daemon cannot be reached, with the reason."""

    why: str


class Recordings(msgspec.Struct, frozen=True, tag="recordings", tag_field="kind"):
    """Recordings that can be downloaded, and the one in progress."""

    running: str  # name of the file in progress; empty if none
    seconds: float
    bytes: int
    files: list["RecordedFile"]
    room_bytes: int  # room for further recordings
    said: str  # words on how the last one ended


class RecordedFile(msgspec.Struct, frozen=True):
    """One complete recording."""

    name: str
    bytes: int


def hello(
    arms: list[str], arm: int, snapshot: Snapshot | None, *, may_command: bool, may_record: bool
) -> Hello:
    """Greeting for a browser that shows arm number `arm`."""
    s = snapshot
    return Hello(
        arms=arms,
        arm=arm,
        joints=s.joints if s else [],
        half_gap=s.half_gap if s else [],
        period_s=s.period_s if s else 0.0,
        modes=[str(mode) for mode in Mode],
        program=s.program if s else "",
        bus_load=s.bus_load if s else None,
        may_command=may_command,
        may_record=may_record,
        force_axes=s.wrench_axes if s else "",
        force_point=s.wrench_point if s else [],
        walls=s.walls if s else None,
        quiet_s=s.quiet_s if s else 0.0,
    )


def words(arm: int, state: State, found: TouchPoint | None = None) -> Words:
    """Words of a State of arm number `arm`; found: its point of contact."""
    return Words(
        arm=arm,
        mode=str(state.mode),
        cause=state.cause,
        advice=advice_on(state.cause),
        armed=state.armed,
        owner=owner(state.permit) if state.permit else "",
        until_told=bool(state.permit and state.permit.detached),
        drives=state.drives,
        unproved=state.unproved,
        silenced=state.silenced,
        touched=state.touched_link,
        flags=state.flags,
        load=load(state),
        force=force(state),
        touch=touch(found) if found is not None and found.placed else None,
        stream=phase_in_words(state.stream) if state.stream else "",
        near=nearest_pair_words(near) if (near := getattr(state, "near", None)) else "",
        meeting=getattr(state, "meeting", None) or None,
        guide=getattr(state, "guide", "") or "",
    )


def force(state: State) -> Force | None:
    """Force at the tool of a State, in a mode with sensing, if a single force explains the
    residuals. Older daemons lack the field."""
    wrench: Wrench | None = getattr(state, "wrench", None)
    if wrench is None or state.mode not in SENSING or wrench.misfit > NO_FIT:
        return None
    size = math.hypot(*wrench.force)
    if size == 0.0:
        return None
    way = [part / size for part in wrench.force]
    return Force(
        way=[round(part, 1) for part in way],
        size=float(round(size)),
        cone=round(math.atan2(most_aside_N(wrench, way), size), 1),
        text=f"{size:.0f} N ± {bound_N(wrench, way):.0f}",
    )


def touch(found: TouchPoint) -> Touch:
    """Message on a point of contact, rounded to 2 cm."""
    point, doubt = (50.0 * found.point).round() / 50.0 + 0.0, round(found.doubt_m, 2)
    text = f"{found.link} ± {100.0 * doubt:.0f} cm"
    return Touch(link=found.link, point=point.tolist(), doubt=doubt, text=text)


def load(state: State) -> Load | None:
    """Load of a State, preferably a recognised one; None if there is none. Older daemons lack the
    fields."""
    for field, announced in (("recognised", False), ("payload", True)):
        found = getattr(state, field, None)
        if found is not None:
            return Load(
                announced, found.mass, list(found.com), getattr(found, "box", None), str(found)
            )
    return None


def owner(permit: Permit) -> str:
    """Name of the user who armed, and on whose behalf."""
    name = user_name(permit.uid)
    return f"{name} on behalf of {permit.on_behalf_of}" if permit.on_behalf_of else name


def advice(status: Status) -> Advice:
    """Content of a Status that States lack."""
    t = status.trajectory
    return Advice(
        name=status.name,
        advice=status.advice,
        checks=status.checks,
        trajectory=f"{t.name}: {t.state}" if t.name else "none configured",
        stream=quality_in_words(status.stream, status.link_position) if status.stream else "",
        lost=lost_samples(status),
        learned=status.learned,
    )


def events(state: State) -> list[Event]:
    """Events of one tick."""
    return [
        Event(state.time_s, state.timing.wall_s, notice.kind, notice.text)
        for notice in state.notices
    ]
