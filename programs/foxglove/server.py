"""`contactd-foxglove`: live States of the running daemon for Foxglove (extra `foxglove`).

A separate process, like every reader: the daemon neither waits for it nor knows of viewers.
"""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click
import msgspec

from common.errors import ContactdError, UnreachableError
from daemon.protocol.state import State
from programs.clients.client import Client, decoded
from programs.command_line.options import PATH, Range

RETRY_S: Final = 1.0
TICKS_UNSEEN: Final = 50  # ticks between two checks for subscribed viewers
NO_NOTICES: Final = b'"notices":[]'  # in the JSON of a State


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--socket", type=PATH, metavar="PATH", help="Control socket of the daemon.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Its clients can see everything and change nothing.",
)
@click.option("--port", type=click.IntRange(1, 65535), default=8765, show_default=True)
@click.option("--rate", type=Range(min=1, max=1000), default=33.0, show_default=True,
              help="Values per second of each joint; notices are never left out.")  # fmt: skip
@click.version_option(package_name="contactd", prog_name="contactd-foxglove")
def main(socket: Path | None, host: str, port: int, rate: float) -> None:
    """Show the running daemon live in Foxglove: open ws://HOST:PORT there.

    Shows the arm in 3D with the touched link highlighted, joint states, named values and the log,
    as `contactd export --foxglove` writes them. Waits for the daemon, and again after its end.
    """
    try:
        import foxglove  # noqa: F401, PLC0415 - an extra
    except ImportError:
        click.echo(
            "contactd-foxglove: needs foxglove-sdk (pip install 'contactd[foxglove]')", err=True
        )
        sys.exit(1)
    os.nice(10)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    try:
        serve(lambda: Client(socket), host, port, rate, lambda text: click.echo(text, err=True))
    except OSError as error:
        click.echo(f"contactd-foxglove: {host}:{port}: {error.strerror or error}", err=True)
        sys.exit(1)


def _leave(number: int, frame: object) -> None:
    raise SystemExit(0)


def serve(
    connect: Callable[[], Client],
    host: str,
    port: int,
    rate: float,
    report: Callable[[str], None],
    going: Callable[[], bool] = lambda: True,
) -> None:
    """Serve viewers until `going()` is false, across restarts of the daemon. Raises OSError or
    RuntimeError if it cannot listen."""
    from foxglove import Context, start_server  # noqa: PLC0415 - an extra

    from programs.recordings.foxglove import FoxgloveChannels  # noqa: PLC0415

    unreachable, decoder = "", msgspec.json.Decoder(State)
    while going():
        try:
            with contextlib.closing(connect()) as client:
                snapshot, _ = client.subscribe()
                context, state = Context(), decoded(decoder, client.packet())
                # Before the server: a viewer that subscribes while they are added may be refused.
                channels = FoxgloveChannels(context, snapshot, list(state.beside))
                viewers = _viewers()
                server = start_server(
                    name="contactd", host=host, port=port, context=context, server_listener=viewers
                )
                try:
                    report(f"ws://{host}:{port}: {len(snapshot.joints)} joints")
                    every = max(round(1.0 / (rate * snapshot.period_s)), 1)
                    _show(client, channels, decoder, every, viewers, going)
                finally:
                    server.stop()
        except UnreachableError as error:
            if str(error) != unreachable:
                report(f"contactd-foxglove: {error}; waiting")
            unreachable = str(error)
        except ContactdError as error:
            report(f"contactd-foxglove: {error}")
        time.sleep(RETRY_S if going() else 0.0)


def _show(
    client: Client,
    channels: Any,
    decoder: msgspec.json.Decoder[State],
    every: int,
    viewers: Any,
    going: Callable[[], bool],
) -> None:
    """Publish each `every`-th State as long as the daemon sends them. Without viewers they are not
    decoded."""
    from programs.recordings.export import Clock  # noqa: PLC0415

    clock, watched, count = Clock(), False, 0
    while going():
        packet = client.packet()
        if watched and (count % every == 0 or NO_NOTICES not in packet):
            state = decoded(decoder, packet)
            channels.log(state, clock.time_ns(state))
        if came := viewers.came:
            viewers.came = False
            channels.show_again()
        if came or count % TICKS_UNSEEN == 0:
            watched = channels.watched
        count += 1


def _viewers() -> Any:
    """Listener that records that a new viewer subscribed."""
    from foxglove.websocket import ServerListener  # noqa: PLC0415 - an extra

    class Viewers(ServerListener):
        came = False

        def on_subscribe(self, client: Any, channel: Any) -> None:
            self.came = True

    return Viewers()


if __name__ == "__main__":
    main(prog_name="contactd-foxglove")
