"""`contactctl watch`, `touches` and `record`: live States shown, streamed as JSON, recorded."""
# ruff: noqa: PLC0415 - rich and mcap are imported by the command that needs them

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from common.errors import ClosedError, UnreachableError
from common.new_file import refuse_suffix
from contactd_client.connection import ANSWER_S
from daemon.modes.table import SENSING
from programs.command_line.options import PATH, Command, Options, Range
from programs.contactctl.replies import print_json

if TYPE_CHECKING:
    from rich.live import Live

    from daemon.protocol.state import Snapshot, State
    from programs.clients.client import Client

FRAMES_PER_S = 10


@click.command(cls=Command)
@click.pass_obj
def watch(options: Options) -> None:
    """Show the joints live until Ctrl-C, also across a `reload`. With --json: print each state on
    one line, until the daemon ends its run.

    After half a second without data the display is marked as not live. After two seconds, or when
    the daemon is gone, the command ends with the last known state of the arm.
    """
    if not options.json and not sys.stdout.isatty():
        raise click.UsageError("watch needs a terminal; use `contactctl watch --json` or `record`")
    try:
        if options.json:
            stream_json(options)
        else:
            show_live(options)
    except KeyboardInterrupt:
        return


@click.command(cls=Command)
@click.argument("file", type=PATH, metavar="[FILE.mcap]", required=False)
@click.pass_obj
def touches(options: Options, file: Path | None) -> None:
    """Print each contact when it has ended, until Ctrl-C, or the contacts of a recording.

    Each is touched, pushed, hit, clamped, leaning or load, with evidence, place on the arm, and
    strength.
    """
    from programs.clients.log_reader import read_log
    from programs.recordings.touches import contacts

    def live() -> Iterator["Snapshot | State"]:
        with options.connect() as client:
            snapshot, states = client.subscribe()
            yield snapshot
            for n, state in enumerate(states):
                if n == 0 and state.mode in SENSING and any(state.thresholded) and not options.json:
                    click.echo("a contact is present already: it counts from now", err=True)
                yield state

    if not options.json and file is None:
        click.echo("contacts are printed when they have ended; Ctrl-C quits", err=True)
    count = 0
    with suppress(KeyboardInterrupt):
        for contact in contacts(read_log(file) if file else live()):
            count += 1
            line = json.dumps(contact.report()) if options.json else str(contact)
            click.echo(line if options.json else f"{contact.evidence.begin_s:8.2f} s  {line}")
    if count == 0 and file is not None:
        click.echo(f"{file}: no contact", err=True)


@click.command(cls=Command)
@click.argument("file", type=PATH, metavar="FILE")
@click.option(
    "--seconds",
    type=Range(min=0, min_open=True),
    metavar="S",
    help="Length in seconds; without it, Ctrl-C ends the recording.",
)
@click.pass_obj
def record(options: Options, file: Path, seconds: float | None) -> None:
    """Record to a new file.

    FILE.mcap: every state, for Foxglove, PlotJuggler and `contactd replay`. FILE.csv: the joint
    positions, as a trajectory that `contactctl start` runs.
    """
    refuse_suffix(file, (".mcap", ".csv"))
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: signals.append(received))
    if ended := _record(options, file, seconds, lambda: bool(signals)):
        raise UnreachableError(ended)


def show_live(options: Options) -> NoReturn:
    """Receive every State and draw some, until interrupted; reconnects to a daemon that reloads its
    files. Raises UnreachableError with the last known state if there is no daemon."""
    from rich.live import Live

    from programs.clients.dashboard import last_known
    from programs.clients.reload import wait_for_start

    client, last = options.connect(), ""

    def draw_all(live: "Live") -> None:
        nonlocal last
        for state in _drawn(client, live):
            last = f"; {last_known(state)}"

    with Live(screen=True, auto_refresh=False) as live:
        try:
            while True:
                with client, suppress(ClosedError):
                    draw_all(live)
                hung_up = f"the daemon hung up: it ends, or reloads its files{last}"
                live.update(hung_up, refresh=True)
                wait_for_start(options.socket)
                client = options.connect()
        except UnreachableError as error:
            raise UnreachableError(f"{error}{last}") from error


def _drawn(client: "Client", live: "Live") -> "Iterator[State]":
    """States of one connection, of which some are drawn, until the daemon closes it; the display is
    marked while none arrive. Raises UnreachableError."""
    from programs.clients.dashboard import SHOWN_SILENCE_S, Dashboard, History, Lag

    snapshot, states = client.subscribe()
    history, lag = History(), Lag()
    drawn_s = heard_s = time.monotonic()
    state = None
    while True:
        if client.waits(1 / FRAMES_PER_S):
            state = next(states)
            history.add(state)
            heard_s = time.monotonic()
            lag_s = lag.of(heard_s, state.time_s)
            if heard_s - drawn_s >= 1 / FRAMES_PER_S:
                drawn_s = heard_s
                live.update(Dashboard(snapshot, state, history.summary(), lag_s), refresh=True)
            yield state
            continue
        silent_s = time.monotonic() - heard_s
        if silent_s >= ANSWER_S:
            raise UnreachableError("the daemon fell silent")
        if state is not None and silent_s >= SHOWN_SILENCE_S:
            shown = Dashboard(snapshot, state, history.summary(), silent_s=silent_s)
            live.update(shown, refresh=True)


def stream_json(options: Options) -> None:
    """Print States as the daemon sends them, until the reader closes the pipe."""
    try:
        with options.connect() as client:
            client.subscribe()
            while True:
                sys.stdout.buffer.write(client.packet() + b"\n")
                sys.stdout.buffer.flush()
    except BrokenPipeError:
        # The interpreter flushes the rest of the buffer at exit, which must not fail again.
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _record(options: Options, file: Path, seconds: float | None, stop: Callable[[], bool]) -> str:
    """Record every State as MCAP, or joint positions as CSV, by the file's suffix. Returns why the
    recording ended early, or an empty string."""
    from programs.clients import recorder
    from programs.clients.trajectory_recorder import record_trajectory

    as_csv = file.suffix.lower() == ".csv"
    made = (record_trajectory if as_csv else recorder.record)(
        options.connect,
        file,
        seconds=seconds,
        stop=stop,
        begun=_announcement(options, file, seconds),
    )
    if options.json:
        print_json(made)
    else:
        click.echo(f"{file}: {made}")
    return made.ended


def _announcement(options: Options, file: Path, seconds: float | None) -> Callable[[], None]:
    """Callback that announces the recording; silent with --json and with --seconds."""

    def announce() -> None:
        if not options.json and seconds is None:
            click.echo(f"recording to {file}; Ctrl-C ends it", err=True)

    return announce
