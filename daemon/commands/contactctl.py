"""`contactctl`: what a person tells the daemon, and sees of it.

Everything heavy is imported by the command that needs it, so that the others start at once.
"""
# ruff: noqa: PLC0415

import math
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from daemon.lease import LONGEST_S, PERSON_S
from errors import ContactdError, ControlError, TrajectoryError, UnreachableError

if TYPE_CHECKING:
    from daemon.client import Client
    from daemon.messages import Command, Reply, Status

WAIT_S = 5.0
POLL_S = 0.02
FRAMES_PER_S = 10

# Where a command leads to, when it takes a while: waited for unless told otherwise.
GOALS: dict[str, frozenset[str]] = {
    "enable": frozenset({"holding"}),
    "pause": frozenset({"holding"}),
    "stop": frozenset({"holding", "off", "faulted"}),
    "disable": frozenset({"off"}),
}
RESTING = frozenset({"off", "holding", "faulted"})  # nothing leaves these by itself


@dataclass(frozen=True, slots=True)
class Options:
    """What was said before the command."""

    socket: Path | None
    json: bool

    def connect(self) -> "Client":
        from daemon.client import Client

        return Client(self.socket)


def _take_json(ctx: click.Context, _: click.Parameter, given: bool) -> None:
    if given:
        ctx.obj = replace(ctx.obj, json=True)


def _take_socket(ctx: click.Context, _: click.Parameter, given: Path | None) -> None:
    if given is not None:
        ctx.obj = replace(ctx.obj, socket=given)


class _Command(click.Command):
    """Takes the options of all commands, too, so that they may stand before or behind it."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.params += [_socket_option(_take_socket), _json_option(_take_json)]


def _socket_option(callback: Any = None) -> click.Option:
    return click.Option(
        ["--socket"],
        type=click.Path(path_type=Path),
        metavar="PATH",
        help="The daemon's control socket, where it is not the usual one.",
        callback=callback,
        expose_value=callback is None,
    )


def _json_option(callback: Any = None) -> click.Option:
    return click.Option(
        ["--json", "as_json"],
        is_flag=True,
        help="Answer in one line of JSON, for programs.",
        callback=callback,
        expose_value=callback is None,
    )


class _Group(click.Group):
    """Lists the commands in the order of a session; one line on stderr for each of our errors."""

    command_class = _Command

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except ContactdError as error:
            click.echo(f"contactctl: {error}", err=True)
            ctx.exit(error.exit_code)


@click.group(
    cls=_Group,
    context_settings={"help_option_names": ["-h", "--help"]},
    params=[_socket_option(), _json_option()],
)
@click.version_option(package_name="contactd", prog_name="contactctl")
@click.pass_context
def main(ctx: click.Context, socket: Path | None, as_json: bool) -> None:
    """Talk to contactd, the daemon that lets a robot arm feel.

    A session usually is: enable, start, arm; then pause or stop; then disable. The program is no
    certified safety function: keep the hardware emergency stop within reach.

    The exit status is 0 when it was done, 1 when the daemon refused, 69 when it cannot be reached.
    """
    ctx.obj = Options(socket, as_json)


_no_wait = click.option("--no-wait", is_flag=True, help="Return at once, before it is done.")


@main.command()
@_no_wait
@click.pass_obj
def enable(options: Options, no_wait: bool) -> None:
    """Energise the drives; the arm holds where it stands."""
    _command(options, "enable", wait=not no_wait)


@main.command()
@click.argument("file", required=False, type=click.Path(path_type=Path), metavar="[FILE.csv]")
@click.option(
    "--from-here",
    is_flag=True,
    help="Run the file as displacements, from wherever the arm stands.",
)
@click.option(
    "--speed",
    type=click.FloatRange(min=0, max=1, min_open=True),
    default=1.0,
    show_default=True,
    help="Run the file slower, at this share of its speed.",
)
@click.pass_obj
def start(options: Options, file: Path | None, from_here: bool, speed: float) -> None:
    """Start a trajectory: the arm moves.

    Without a file: what was paused goes on; else the configured trajectory begins. A file has a
    column time_s [s] and one for each joint that moves [rad]; it is checked against every limit
    before anything moves, and the arm must stand where it begins.
    """
    if file is None:
        if from_here or speed != 1.0:
            raise click.UsageError("--from-here and --speed are about a file")
        _command(options, "start")
        return
    from daemon.trajectory_file import read_trajectory

    with options.connect() as client:
        trajectory = read_trajectory(file, _status(client).joints)
        try:
            client.load_trajectory(
                trajectory.joints,
                [time_s / speed for time_s in trajectory.times],
                trajectory.positions,
                name=file.name,
                from_here=from_here,
            )
        except TrajectoryError as error:
            raise trajectory.placed(error) from error
        _answer(options, client.start_loaded())


@main.command()
@_no_wait
@click.pass_obj
def pause(options: Options, no_wait: bool) -> None:
    """Halt the trajectory; the arm stays armed. `start` goes on with it, `stop` forgets it."""
    _command(options, "pause", wait=not no_wait)


@main.command()
@click.option(
    "--lease",
    "lease_s",
    type=click.FloatRange(min=0, max=LONGEST_S, min_open=True),
    default=PERSON_S,
    show_default=True,
    metavar="S",
    help="How long it stays armed, in seconds, unless you arm again.",
)
@click.pass_obj
def arm(options: Options, lease_s: float) -> None:
    """Let the arm yield to contact. Refused, with every reason, while it cannot be trusted.

    Shows each check as passed or failed. Arming again renews the lease; while somebody else holds
    it, it is refused. When the lease runs out the arm is disarmed, and holds if it is being guided.
    """
    if math.isnan(lease_s):
        raise click.BadParameter("nan is not a time", param_hint="--lease")
    with options.connect() as client:
        reply = client.arm(lease_s, detached=True)
    _answer(options, reply)


@main.command()
@click.pass_obj
def disarm(options: Options) -> None:
    """Stop yielding to contact. Contacts are still reported, and collisions stop the arm."""
    _command(options, "disarm")


@main.command()
@_no_wait
@click.pass_obj
def stop(options: Options, no_wait: bool) -> None:
    """Stop the arm at once, and disarm it. Works in every mode."""
    _command(options, "stop", wait=not no_wait)


@main.command()
@_no_wait
@click.pass_obj
def disable(options: Options, no_wait: bool) -> None:
    """Take the power off the drives. What each joint does then is configured."""
    _command(options, "disable", wait=not no_wait)


@main.command()
@click.pass_obj
def reset(options: Options) -> None:
    """Acknowledge a fault. Energises and moves nothing."""
    _command(options, "reset")


@main.command(context_settings={"ignore_unknown_options": True})  # -0.1 is no option
@click.argument("joint", required=False)
@click.argument("value", type=float, required=False)
@click.pass_obj
def gain(options: Options, joint: str | None, value: float | None) -> None:
    """Show or change how softly joints yield: K_a [rad/s per Nm].

    The joint gets there within half a second, also in somebody's hand. The configuration is not
    changed: the next start of the daemon begins from it.
    """
    from daemon.messages import Request

    if value is not None and not math.isfinite(value):
        raise click.UsageError(f"{value:g} is not a gain")  # nor is it a number in JSON
    with options.connect() as client:
        if joint is not None and value is not None:
            _answer(options, client.ask(Request("gain", joint=joint, gain=value)))
            return
        found = _status(client)
    gains = dict(zip(found.joints, found.gain, strict=True))
    if joint is not None and joint not in gains:
        raise click.UsageError(f"no joint {joint!r}; there are: {', '.join(gains)}")
    shown = gains if joint is None else {joint: gains[joint]}
    if options.json:
        _print_json(shown)
        return
    for name, k in shown.items():
        click.echo(f"{name:16} {k:g}")


@main.command()
@click.pass_obj
def status(options: Options) -> None:
    """Show mode, joints, and what arming needs."""
    with options.connect() as client:
        found = _status(client)
    if options.json:
        _print_json(found)
        return
    from rich.console import Console

    from daemon.view import status_view

    # Nothing is cut off where the output goes to a file.
    Console(width=None if sys.stdout.isatty() else 120).print(status_view(found))


@main.command()
@click.pass_obj
def watch(options: Options) -> None:
    """Show the joints live, until Ctrl-C. With --json: every state, one line each."""
    if not options.json and not sys.stdout.isatty():
        raise click.UsageError("watch needs a terminal; use `contactctl watch --json` or `record`")
    with options.connect() as client:
        try:
            _stream_json(client) if options.json else _watch(client)
        except KeyboardInterrupt:
            return


@main.command()
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE")
@click.option(
    "--seconds",
    type=click.FloatRange(min=0, min_open=True),
    help="End after so many seconds; without it, Ctrl-C ends the recording.",
)
@click.pass_obj
def record(options: Options, file: Path, seconds: float | None) -> None:
    """Record into a new file.

    FILE.mcap: every state, for Foxglove, PlotJuggler and `contactd replay`. FILE.csv: where the
    joints go, as a trajectory that `contactctl start` runs.
    """
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: signals.append(received))
    if not options.json and seconds is None:
        click.echo(f"recording to {file}; Ctrl-C ends it", err=True)
    as_csv = file.suffix.lower() == ".csv"
    ended = (_record_csv if as_csv else _record_states)(
        options, file, seconds, lambda: bool(signals)
    )
    if ended:
        raise UnreachableError(ended)


def _record_states(
    options: Options, file: Path, seconds: float | None, stop: Callable[[], bool]
) -> str:
    from daemon.recorder import record

    made = record(options.connect, file, seconds=seconds, stop=stop)
    if options.json:
        _print_json(made)
    else:
        again = f", {made.snapshots} snapshots" if made.snapshots > 1 else ""
        click.echo(
            f"{file}: {made.duration_s:.1f} s, {made.states} states, {made.lost} lost{again}"
        )
    return made.ended


def _record_csv(
    options: Options, file: Path, seconds: float | None, stop: Callable[[], bool]
) -> str:
    from daemon.trajectory_recorder import record_trajectory

    made = record_trajectory(options.connect, file, seconds=seconds, stop=stop)
    if options.json:
        _print_json(made)
    else:
        click.echo(f"{file}: {made.duration_s:.1f} s, {made.samples} samples")
    return made.ended


def _command(options: Options, command: "Command", wait: bool = False) -> None:
    """Ask for `command`, wait where it takes a while, and say where it ended; exit 1 if not."""
    with options.connect() as client:
        reply = client.request(command)
        if wait and reply.ok:
            reply = _await(client, reply, GOALS[command])
    _answer(options, reply)


def _answer(options: Options, reply: "Reply") -> None:
    """What came of it, on stdout or stderr; exit 1 if nothing did."""
    if options.json:
        _print_json(reply)
    else:
        for check in reply.checks:
            click.echo(check, err=not reply.ok)
        said = reply.message or (reply.mode if reply.ok else "refused")
        click.echo(said if reply.ok else f"contactctl: {said}", err=not reply.ok)
        # The checks have said it already.
        for reason in reply.reasons if not reply.checks else ():
            click.echo(f"  - {reason}", err=True)
    if not reply.ok:
        sys.exit(1)


def _await(client: "Client", first: "Reply", goal: frozenset[str]) -> "Reply":
    """Poll until the mode is in `goal`, comes to rest elsewhere, or WAIT_S have passed."""
    from daemon.messages import Reply

    deadline = time.monotonic() + WAIT_S
    left = False
    while True:
        now = _status(client)
        left = left or now.mode != first.mode
        late = time.monotonic() > deadline
        if now.mode in goal or late or (left and now.mode in RESTING):
            break
        time.sleep(POLL_S)
    text = f"{now.mode}{', armed' if now.armed else ''}: {now.cause}"
    if now.mode not in goal:
        expected = "holding" if "holding" in goal else "off"
        text = f"not {expected} {f'after {WAIT_S:.0f} s' if late else 'but'} {text}"
    return Reply(ok=now.mode in goal, message=text, mode=now.mode, armed=now.armed)


def _status(client: "Client") -> "Status":
    reply = client.request("status")
    if reply.status is None:
        raise ControlError("; ".join([reply.message or "no status", *reply.reasons]))
    return reply.status


def _watch(client: "Client") -> None:
    """Take every state, draw some."""
    from rich.live import Live

    from daemon.view import Dashboard, History

    snapshot, states = client.subscribe()
    history = History()
    drawn_s = 0.0
    with Live(screen=True, auto_refresh=False) as live:
        for state in states:
            history.add(state)
            now_s = time.monotonic()
            if now_s - drawn_s >= 1 / FRAMES_PER_S:
                drawn_s = now_s
                live.update(Dashboard(snapshot, state, history.summary()), refresh=True)


def _stream_json(client: "Client") -> None:
    """The states as the daemon sends them, until the reader of the pipe has had enough."""
    client.subscribe()
    try:
        while True:
            sys.stdout.buffer.write(client.packet() + b"\n")
            sys.stdout.buffer.flush()
    except BrokenPipeError:
        return


def _print_json(message: Any) -> None:
    import msgspec

    click.echo(msgspec.json.encode(message).decode())
