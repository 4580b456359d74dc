"""`contactctl follow`: streams targets from another arm or a file for the arm to follow."""
# ruff: noqa: PLC0415 - the client is imported by the command that needs it

import itertools
import select
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from common.errors import ControlError, UnreachableError
from contactd_client.paths import view_socket_path
from daemon.motion.trajectory_file import read_trajectory
from programs.command_line.options import PATH, Command, Options, Range
from programs.command_line.sentences import say
from programs.contactctl.replies import IF_IT_MOVES, NOT_REACHED_ON_ITS_WAY

if TYPE_CHECKING:
    from contactd_client.messages import StreamState
    from contactd_client.stream import Stream
    from daemon.motion.trajectory_file import TrajectoryFile
    from daemon.protocol.replies import Status

REST_S = 1.0  # for which the last target is repeated, so that the arm arrives


class LeaderError(ControlError):
    """Error of the leader: unreachable, an arm with other joints, or silent."""


@dataclass(frozen=True, slots=True)
class SentTarget:
    """One target of a source: pose [rad], velocity [rad/s] or None, and the source's time [s]."""

    q: list[float]
    velocity: list[float] | None
    time_s: float


@click.command(cls=Command)
@click.argument("file", required=False, type=PATH, metavar="[FILE.csv]")
@click.option(
    "--leader", type=PATH, metavar="SOCKET", help="Follow the arm of another contactd, live."
)
@click.option(
    "--rate",
    type=Range(min=20, max=200),
    default=50.0,
    show_default=True,
    metavar="HZ",
    help="Targets of a file per second.",
)
@click.pass_obj
def follow(options: Options, file: Path | None, leader: Path | None, rate: float) -> None:
    """Follow a stream of targets, from another arm or a file: the arm moves.

    The arm goes slowly to the first target, at most `stream.reach` away, then follows within all
    limits. It reacts to a contact as configured, and continues as `stream.after_contact` says.
    Enter makes it rejoin the stream; Ctrl-C halts it.
    """
    if (file is None) == (leader is None):
        raise click.UsageError("give either a FILE.csv or --leader SOCKET")
    from contactd_client.client import Client

    with options.connect() as asking:
        status, path = asking.ask_status(), asking.path
    trajectory = read_trajectory(file, status.joints) if file else None
    try:
        with Client(path) as client, client.follow() as stream:
            if trajectory is None:
                _send(_of_leader(leader or path, path, status.joints), stream)
                return
            _send(_of_file(trajectory, status, rate, lambda: _follows(stream)), stream)
            _refuse_elsewhere(stream)
    except KeyboardInterrupt:
        say("\nhalted", err=True)
    except LeaderError as error:
        raise ControlError(f"{error}; the arm halts") from error
    except UnreachableError as error:
        raise type(error)(f"{NOT_REACHED_ON_ITS_WAY} ({error})") from error
    except ControlError as error:
        raise ControlError(f"{_moving(options)}{error}") from error


def _refuse_elsewhere(stream: "Stream") -> None:
    """Raise ControlError if the arm does not follow at the end of a file."""
    if stream.state and not _follows(stream):
        raise ControlError(
            f"at the end of the file the arm does not follow: {_phase(stream.state)}"
        )


def _moving(options: Options) -> str:
    """Words on joints not confirmed at standstill after a stream was refused; empty if none."""
    with options.connect() as asking:
        unproved = asking.ask_status().unproved
    return f"not seen to stand: {', '.join(unproved)}; {IF_IT_MOVES}; " if unproved else ""


def _send(source: Iterator[SentTarget], stream: "Stream") -> None:
    """Send the targets of a source, print changes of phase and new warnings, and rejoin when Enter
    is pressed."""
    shown, warned = "", 0
    for sent in source:
        stream.to(sent.q, sent.velocity, sent.time_s)
        reply = stream.reply
        if reply is None or (state := reply.get("stream")) is None:
            continue
        words = _phase(state) + ("" if reply.get("armed") else "; not armed")
        if words != shown:
            shown = words
            say(words)
        warnings = reply.get("warnings", [])
        for text in warnings[warned:]:
            say(f"  warning: {text}", err=True)
        warned = len(warnings)
        if _entered():
            try:
                stream.rejoin(sent.q, sent.time_s)
            except ControlError as error:
                say(str(error), err=True)


def _follows(stream: "Stream") -> bool:
    return stream.state is not None and stream.state["phase"] == "following"


def _phase(stream: "StreamState") -> str:
    """Phase of the stream in words, with the joint of a present contact."""
    from programs.clients.stream_words import AFTER_CONTACT, PHASES

    phase, words = stream["phase"], PHASES[stream["phase"]]
    if touched := stream.get("contact", ""):
        words = f"{words}; {touched.partition(' at ')[2].partition(',')[0]} is touched"
    elif phase == "interrupted":
        after = AFTER_CONTACT[stream["after_contact"]]
        words = f"the contact is over; after the quiet time the arm {after}"
    elif phase == "waiting":
        words = f"{words}; Enter rejoins"
    return f"{phase}: {words}"


def _entered() -> bool:
    """True if a person has pressed Enter since the last call."""
    if not (sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]):
        return False
    return bool(sys.stdin.readline())


def _of_file(
    file: "TrajectoryFile", status: "Status", rate_hz: float, joined: Callable[[], bool]
) -> Iterator[SentTarget]:
    """Targets from a trajectory: its first pose until the arm has joined, then at its own speed;
    joints that it does not name keep their positions."""
    places = [status.joints.index(joint) for joint in file.joints]
    begun_s, span_s = time.monotonic(), file.times[-1] - file.times[0]
    begins_s, waits = 0.0, True
    for k in itertools.count():
        sent_s = k / rate_hz
        time.sleep(max(begun_s + sent_s - time.monotonic(), 0.0))
        waits = waits and (k == 0 or not joined())
        begins_s = sent_s if waits else begins_s
        q = list(status.link_position)
        for place, value in zip(places, file.at(file.times[0] + sent_s - begins_s), strict=True):
            q[place] = value
        yield SentTarget(q, None, sent_s)
        if sent_s - begins_s > span_s + REST_S:
            return


def _of_leader(socket: Path, own: Path, joints: Sequence[str]) -> Iterator[SentTarget]:
    """Targets from the poses that another arm's daemon publishes. Raises LeaderError."""
    from contactd_client.client import Client

    view = socket if socket.name.endswith("-view.sock") else view_socket_path(socket)
    if view.resolve() == view_socket_path(own).resolve():
        raise ControlError(f"{socket} is this arm itself; --leader takes the socket of another one")
    try:
        with Client(view) as client:
            snapshot, states = client.states()
            _refuse_others(snapshot["joints"], joints)
            for state in states:
                yield SentTarget(state["link_position"], state["link_velocity"], state["time_s"])
    except ControlError as error:
        raise LeaderError(f"leader {socket}: {error}") from error


def _refuse_others(leads: Sequence[str], joints: Sequence[str]) -> None:
    if list(leads) != list(joints):
        raise ControlError(
            f"it has the joints {', '.join(leads)}; this arm has {', '.join(joints)}: names and "
            "order must be the same"
        )
