"""`contactctl follow`: the arm follows another arm, or a file, as a stream of targets."""
# ruff: noqa: PLC0415 - the client is imported by the command that needs it

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from common.errors import ControlError, TrajectoryError
from contactd_client.paths import view_socket_path
from programs.command_line.options import PATH, Command, Options, Range
from programs.command_line.sentences import say

if TYPE_CHECKING:
    from contactd_client.stream import Stream


@dataclass(frozen=True, slots=True)
class Sent:
    """One target of a source: pose, velocity or None, and the source's time [s]."""

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
    type=Range(min=10, max=200),
    default=50.0,
    show_default=True,
    metavar="HZ",
    help="Targets of a file per second.",
)
@click.pass_obj
def follow(options: Options, file: Path | None, leader: Path | None, rate: float) -> None:
    """Follow a stream of targets, from another arm or a file: the arm moves.

    It goes slowly to the first target, at most `stream.reach` away, then follows within all
    limits. A contact has the configured reaction; afterwards the arm goes on as
    `stream.after_contact` says. Enter asks it to rejoin the stream; Ctrl-C halts it.
    """
    if (file is None) == (leader is None):
        raise click.UsageError("either a FILE.csv, or --leader SOCKET")
    from contactd_client.client import Client

    with options.connect() as asking:
        joints = asking.ask_status().joints
        path = asking.path
    source = _of_file(file, joints, rate) if file else _of_leader(leader or path, joints)
    with Client(path) as client, client.follow() as stream:
        try:
            _send(source, stream)
        except KeyboardInterrupt:
            say("halted", err=True)


def _send(source: Iterator[Sent], stream: "Stream") -> None:
    """Send what a source gives, and print each change of phase."""
    shown = ""
    for sent in source:
        stream.to(sent.q, sent.velocity, sent.time_s)
        state = stream.state
        phase = "" if state is None else state["phase"]
        if phase != shown and state is not None:
            shown = phase
            say(f"{phase}: {state.get('contact') or state['sender']}")


def _of_leader(socket: Path, joints: Sequence[str]) -> Iterator[Sent]:
    """Poses of another arm, as its daemon publishes them."""
    from contactd_client.client import Client

    view = socket if socket.name.endswith("-view.sock") else view_socket_path(socket)
    with Client(view) as client:
        snapshot, states = client.states()
        if list(snapshot["joints"]) != list(joints):
            raise ControlError(
                f"the leader has the joints {', '.join(snapshot['joints'])}; this arm has "
                f"{', '.join(joints)}: they must be the same, in this order"
            )
        for state in states:
            yield Sent(state["link_position"], state["link_velocity"], state["time_s"])
