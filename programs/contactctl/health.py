"""`contactctl health`: shows the daily records of the gears as a table, JSON, or a plot."""

import math
import os
from pathlib import Path
from typing import Any

import click
import msgspec

from common.errors import LogError
from common.new_file import refuse_suffix, refuse_unless_new, whole_file
from daemon.service.black_box import default_directory
from programs.recordings.pictures import without_matplotlib
from programs.trends.day import Day, Days, read_days, today
from programs.trends.findings import QUANTITIES, JointHealth, Trend, What, health

# State directory of the default systemd service, for a user who has no records of their own.
_SERVICE = Path("/var/lib/contactd")


def show_health(directory: Path | None, plot: Path | None, *, as_json: bool) -> int:
    """Show the records of every arm in a state directory; returns the exit status. Raises LogError
    if there are none, or they cannot be plotted."""
    state = _state(directory)
    arms = {folder.name: read_days(folder, until=today()) for folder in _folders(state)}
    arms = {name: days for name, days in arms.items() if days.days or days.words}
    if not arms:
        raise LogError(
            f"{state / 'trends'}: no records yet; `contactd run` writes one for each day on which "
            "the arm moved (--directory gives another place)"
        )
    found = {name: health(days.days) for name, days in arms.items()}
    if plot is not None:
        if len(arms) > 1:
            raise LogError(f"{state}: records of several arms: {', '.join(arms)}; plot one alone")
        ((name, days),) = arms.items()
        if not days.days:
            raise LogError(f"{state / 'trends' / name}: no record that can be plotted")
        _plot(days.days, plot)
    if as_json:
        click.echo(msgspec.json.encode([_plain(arms[name], found[name]) for name in arms]))
    else:
        for name in arms:
            _print(arms[name], found[name])
    if not all(days.days for days in arms.values()):  # nothing is known of one of them
        return LogError.exit_code
    return int(any(joint.words for joints in found.values() for joint in joints))


def _state(directory: Path | None) -> Path:
    if directory is not None:
        return directory
    own = default_directory()
    return own if _is_there(own / "trends") or not _is_there(_SERVICE / "trends") else _SERVICE


def _is_there(folder: Path) -> bool:
    """True if a folder exists or this user may not access it, which reading it will report."""
    try:
        return folder.exists()
    except OSError:
        return True


def _folders(state: Path) -> list[Path]:
    try:
        return sorted(Path(entry.path) for entry in os.scandir(state / "trends") if entry.is_dir())
    except FileNotFoundError:
        return []
    except OSError as error:
        raise LogError(f"{state / 'trends'}: {error.strerror}") from error


def _plain(days: Days, joints: tuple[JointHealth, ...]) -> dict[str, Any]:
    """Records of an arm for JSON; NaN and infinity become null."""
    return {
        "arm": days.days[-1].arm if days.days else "",
        "days": len(days.days),
        "last": days.days[-1].date if days.days else None,
        "damaged": days.damaged,
        "left_out": days.left_out,
        "joints": [
            {
                **msgspec.to_builtins(joint),
                "named": [trend.what for trend in joint.named],
                "text": joint.words,
                "last": _last(days.days, joint.joint),
            }
            for joint in joints
        ],
    }


def _last(days: tuple[Day, ...], joint: str) -> dict[str, float | None]:
    values = {what: q.value(days[-1].joints[joint]) for what, q in QUANTITIES.items()}
    return {what: value if math.isfinite(value) else None for what, value in values.items()}


def _print(days: Days, joints: tuple[JointHealth, ...]) -> None:
    from rich.table import Table  # noqa: PLC0415 - slow
    from rich.text import Text  # noqa: PLC0415

    from programs.command_line.console import on_stdout  # noqa: PLC0415

    to = on_stdout()
    if days.days:
        first, last = days.days[0], days.days[-1]
        to.print(Text(f"{last.arm}: {_count(len(days.days))}, {first.date} to {last.date}", "bold"))
    table = Table(box=None, padding=(0, 1), header_style="bold")
    table.add_column("joint")
    table.add_column("identified")
    for name in ("moved", *(q.column for q in QUANTITIES.values())):
        table.add_column(name, justify="right")
    for joint in joints:
        day = days.days[-1].joints[joint.joint]
        trends = {trend.what: trend for trend in joint.trends}
        table.add_row(
            Text(joint.joint, "yellow" if joint.words else ""),
            joint.identified or "-",
            f"{day.moved_s / 60.0:.1f} min",
            *(_cell(what, q.value(day), trends.get(what)) for what, q in QUANTITIES.items()),
        )
    if joints:
        to.print(table)
        to.print(Text("on the last day, and the change since the first; -: not observed", "dim"))
    warnings = [f"{joint.joint}: {joint.words}" for joint in joints if joint.words]
    for line in warnings or ["no warnings for any joint"] * bool(joints):
        to.print(Text(line, "yellow" if warnings else "green"))
    for line in days.words:
        to.print(Text(line, "bold red"))


def _count(days: int) -> str:
    return "1 day" if days == 1 else f"{days} days"


def _cell(what: What, value: float, trend: Trend | None) -> Any:
    from rich.text import Text  # noqa: PLC0415

    if not math.isfinite(value):
        return Text("-", "dim")
    q = QUANTITIES[what]
    text = Text(q.shown(value))
    if trend is not None:
        change = q.scale * (trend.last - trend.first)
        text.append(f" {change:+.{q.digits}f}", "bold yellow" if trend.clear else "dim")
    return text


def _plot(days: tuple[Day, ...], path: Path) -> None:
    refuse_suffix(path, (".png", ".svg", ".pdf"))
    refuse_unless_new(path)
    try:
        import matplotlib as mpl  # noqa: PLC0415 - slow, and perhaps not there

        mpl.use("Agg")
        from matplotlib import pyplot as plt  # noqa: PLC0415
    except ImportError as error:
        raise without_matplotlib(path) from error
    from datetime import date  # noqa: PLC0415

    rows_of = math.ceil(len(QUANTITIES) / 2)
    figure, axes = plt.subplots(rows_of, 2, figsize=(11.0, 6.5), layout="constrained", sharex=True)
    for axis, q in zip(axes.ravel(), QUANTITIES.values(), strict=False):
        for k, name in enumerate(days[-1].joints):
            rows = [
                (date.fromisoformat(day.date), q.scale * q.value(day.joints[name]))
                for day in days
                if name in day.joints
            ]
            at = [when for when, value in rows if math.isfinite(value)]
            values = [value for _, value in rows if math.isfinite(value)]
            if at:
                axis.plot(at, values, "o-", ms=3, lw=1, label=name, color=f"C{k}")
        axis.set(ylabel=q.label)
        axis.grid(alpha=0.3)
    handles = {line.get_label(): line for axis in axes.ravel() for line in axis.get_lines()}
    figure.legend(handles.values(), handles.keys(), loc="outside right upper")
    figure.autofmt_xdate()
    figure.suptitle(f"{days[-1].arm}, day by day")
    try:
        with whole_file(path) as partial:
            figure.savefig(partial, dpi=120)
    finally:
        plt.close(figure)
