"""`contactd replay`: summarises a recording and checks that its estimates are bit-identical."""

import datetime
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import msgspec

from common.errors import LogError
from programs.clients.replay import Replay, replay
from programs.command_line.progress import reading
from programs.recordings.contents import ContactSeen, Contents

CONTACTS_SHOWN = 40


def print_replay(file: Path, *, as_json: bool) -> bool:
    """Replay `file` and report; True if it is complete and all estimates are bit-identical. Raises
    LogError if there is nothing to read, or nothing that can be compared."""
    contents = Contents()
    with reading(file, shown=not as_json) as progress:
        result = replay(file, contents.take, progress)
    if as_json:
        report = {
            "identical": result.identical,
            "result": asdict(result),
            "contents": data(contents),
        }
        click.echo(msgspec.json.encode(report))
    else:
        click.echo("\n".join([*lines(file, contents), *verdict(contents, result)]))
    if result.older:
        raise LogError(result.older)
    if result.broken and not as_json:
        click.echo(f"contactd: {result.broken}", err=True)
    return result.identical and not result.broken


def data(contents: Contents) -> dict[str, Any]:
    """Contents as data for JSON."""
    report = {name: value for name, value in asdict(contents).items() if not name.startswith("_")}
    return {**report, "duration_s": contents.duration_s}


def lines(file: Path, contents: Contents) -> list[str]:
    """Contents as lines of text."""
    alone = len(contents.joints) == 1
    joints = contents.joints[0] if alone else f"{len(contents.joints)} joints"
    report = [
        f"{file}: {contents.duration_s:.2f} s, {contents.states} states of {joints}"
        f"{_when(contents)}",
        f"  recorded by {contents.program}, format {contents.format}",
        f"  modes     {', '.join(f'{mode} {s:.1f} s' for mode, s in contents.modes.items())}"
        f"; armed {contents.armed_s:.1f} s",
    ]
    shown = contents.contacts[:CONTACTS_SHOWN]
    report += listed("contacts", [contact_row(k, one) for k, one in enumerate(shown, start=1)])
    if len(contents.contacts) > len(shown):
        report.append(
            f"            and {len(contents.contacts) - len(shown)} more: --json lists them"
        )
    report += listed("faults", [f"{one.time_s:9.2f} s  {one.text}" for one in contents.faults])
    report.append(f"  lost      {contents.lost or 'no'} states between the first and the last")
    return report


def listed(name: str, rows: list[str]) -> list[str]:
    """Rows under a name; one line where there are none."""
    if not rows:
        return [f"  {name:9} none"]
    return [f"  {name if k == 0 else '':9} {row}" for k, row in enumerate(rows)]


def contact_row(number: int, one: ContactSeen) -> str:
    """One contact as a line of text."""
    lasted = "to the end" if one.duration_s is None else f"for {one.duration_s:.2f} s"
    hard = ", a collision" if one.level == "collision" else ""
    return (
        f"{number:3} {one.time_s:9.2f} s  {one.joint:16} {one.peak:+.2f} Nm at most, beyond "
        f"{one.threshold:.2f} Nm, {lasted}{hard}"
    )


def _when(contents: Contents) -> str:
    """Time of the recording; empty for a lockstep run, which has no time of day."""
    if not contents.begun_wall_s:
        return ""
    try:
        at = datetime.datetime.fromtimestamp(contents.begun_wall_s, datetime.UTC)
    except (OverflowError, OSError, ValueError):
        return ", at no time of day"
    return f", {at:%Y-%m-%d %H:%M:%S} UTC"


def verdict(contents: Contents, result: Replay) -> list[str]:
    """Result of the comparison as lines of text; empty if none was made."""
    if result.older:
        return []
    report = []
    if difference := result.difference:
        after = contents.joints if isinstance(difference.recorded, list) else ()
        report += [
            f"  replayed  differs first in tick {difference.tick}, {difference.field}:",
            f"              recorded {difference.recorded}",
            f"              replayed {difference.replayed}",
        ]
        report += [f"              joints   {', '.join(after)}"] if len(after) > 1 else []
    elif result.states:
        report.append(f"  replayed  {result.states} states, bit-identical")
    if result.skipped:
        report.append(f"            {result.skipped} states after a gap could not be compared")
    return report
