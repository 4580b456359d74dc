"""`contactd replay`: prints whether a recording's estimates still come out the same, bit by bit."""

from pathlib import Path

import click
import msgspec

from daemon.clients.replay import replay


def print_replay(file: Path, *, as_json: bool) -> bool:
    """Replay `file` and report; True if it is whole and every estimate came out the same."""
    result = replay(file)
    whole = result.identical and not result.broken
    if as_json:
        click.echo(msgspec.json.encode({"identical": result.identical, "result": result}))
        return whole
    if difference := result.difference:
        click.echo(
            f"{file}: differs first in tick {difference.tick}, {difference.field}:\n"
            f"  recorded {difference.recorded}\n  replayed {difference.replayed}"
        )
    else:
        click.echo(f"{file}: {result.states} states replayed, bit-identical")
    if result.skipped:
        click.echo(f"  {result.skipped} states after a gap could not be compared")
    if result.broken:
        click.echo(f"contactd: {result.broken}", err=True)
    return whole
