"""Live States of the daemon for `contactctl`: shown, streamed as JSON, recorded."""
# ruff: noqa: PLC0415 - rich and mcap are imported by the command that needs them

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from daemon.commands.options import Options
from daemon.commands.replies import print_json
from errors import HungUpError

if TYPE_CHECKING:
    from rich.live import Live

    from daemon.clients.client import Client

FRAMES_PER_S = 10


def show_live(options: Options) -> NoReturn:
    """Take every State and draw some, until interrupted; those of a daemon that reads its files
    anew, too. Raises UnreachableError where there is none any more."""
    from rich.live import Live

    from daemon.clients.reload import wait_for_start

    client = options.connect()
    with Live(screen=True, auto_refresh=False) as live:
        while True:
            with client, suppress(HungUpError):
                _draw(client, live)
            live.update("the daemon hung up: it ends, or reads its files anew", refresh=True)
            wait_for_start(options.socket)
            client = options.connect()


def _draw(client: "Client", live: "Live") -> None:
    """Draw what one connection brings, until the daemon ends it. Raises UnreachableError."""
    from daemon.clients.dashboard import Dashboard, History, Lag

    snapshot, states = client.subscribe()
    history, lag = History(), Lag()
    drawn_s = 0.0
    for state in states:
        history.add(state)
        now_s = time.monotonic()
        lag_s = lag.of(now_s, state.time_s)
        if now_s - drawn_s >= 1 / FRAMES_PER_S:
            drawn_s = now_s
            live.update(Dashboard(snapshot, state, history.summary(), lag_s), refresh=True)


def stream_json(options: Options) -> None:
    """Print the States as the daemon sends them, until the reader closes the pipe."""
    try:
        with options.connect() as client:
            client.subscribe()
            while True:
                sys.stdout.buffer.write(client.packet() + b"\n")
                sys.stdout.buffer.flush()
    except BrokenPipeError:
        # What is left in the buffer is flushed once more at exit, and must go somewhere.
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def record_states(
    options: Options, file: Path, seconds: float | None, stop: Callable[[], bool]
) -> str:
    """Record every State as MCAP. Returns why it ended early, or an empty text."""
    from daemon.clients.recorder import record

    begun = _announcement(options, file, seconds)
    made = record(options.connect, file, seconds=seconds, stop=stop, begun=begun)
    if options.json:
        print_json(made)
    else:
        again = f", {made.snapshots} snapshots" if made.snapshots > 1 else ""
        click.echo(
            f"{file}: {made.duration_s:.1f} s, {made.states} states, {made.lost} lost{again}"
        )
    return made.ended


def record_csv(
    options: Options, file: Path, seconds: float | None, stop: Callable[[], bool]
) -> str:
    """Record joint positions as CSV. Returns why it ended early, or an empty text."""
    from daemon.clients.trajectory_recorder import record_trajectory

    begun = _announcement(options, file, seconds)
    made = record_trajectory(options.connect, file, seconds=seconds, stop=stop, begun=begun)
    if options.json:
        print_json(made)
    else:
        click.echo(f"{file}: {made.duration_s:.1f} s, {made.samples} samples")
    return made.ended


def _announcement(options: Options, file: Path, seconds: float | None) -> Callable[[], None]:
    """Callback that announces a recording to a person; silent for programs and with --seconds."""

    def announce() -> None:
        if not options.json and seconds is None:
            click.echo(f"recording to {file}; Ctrl-C ends it", err=True)

    return announce
