"""Report of `contactctl status`, as rich renderables that depend on the message alone."""

from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from daemon.protocol.lease import in_words
from daemon.protocol.replies import Grant, Status, Trajectory
from daemon.protocol.state import StreamState
from programs.clients.nearest_pair import nearest_pair_words
from programs.clients.payload import payload_in_words
from programs.clients.sensing import lost_samples, not_sensing, sensing_for_s
from programs.clients.sensitivity import sensitivity_lines
from programs.clients.stream_words import AFTER_CONTACT, phase_in_words, quality_in_words
from programs.clients.styles import (
    MODE_STYLES,
    SIDE_STYLES,
    clock,
    drive_text,
    not_seen_to_stand,
    residual_style,
)
from programs.clients.user_names import user_name
from programs.clients.wrench import wrench_words

SHARE = "share: in force of the configured level, lowered by learning; 100% while in doubt"


def status_head(status: Status) -> Table:
    """First rows of the report: mode, cause, and what to do."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True, overflow="crop")
    table.add_column()
    permission = _permission(status)
    mode = Text(f" {status.mode.upper()} ", MODE_STYLES.get(status.mode, ""))
    table.add_row("mode", Text.assemble(mode, "  ", permission))
    if doubt := not_seen_to_stand(status):
        table.add_row("", doubt)
    if words := not_sensing(status, status.joints):
        table.add_row("", Text(words, "bold red"))
    table.add_row("cause", Text(_cause(status)))  # Text keeps brackets from being rich markup
    if status.advice:
        table.add_row("to do", Text(status.advice, "yellow"))
    return table


def status_report(status: Status, socket: Path | None = None, point: str = "") -> RenderableType:
    """Complete report on the daemon at this control socket; point: point of contact in words."""
    table = status_head(status)
    table.add_row(*_arming(status))
    table.add_row("robot", Text(f"{status.name} ({status.configuration})"))
    if status.changed:
        table.add_row("", Text(_changed(status), "yellow"))
    table.add_row("trajectory", Text(_trajectory(status.trajectory, status.stream)))
    if status.stream is not None:
        table.add_row("stream", Text(phase_in_words(status.stream)))
        table.add_row("", Text(quality_in_words(status.stream, status.link_position)))
    if status.gears:
        table.add_row("gears", Text("\n".join(status.gears), "yellow"))
    _hand(table, status)
    if status.wrench is not None:
        table.add_row("force", Text(wrench_words(status.wrench, status.wrench_axes)))
    if point:
        table.add_row("touched", Text(point))
    if near := status.unguarded or (nearest_pair_words(status.near) if status.near else ""):
        table.add_row("near", Text(near, "yellow" if status.unguarded else ""))
    missed = f"{status.missed} missed, late at most {status.lateness_max_us / 1e3:.2f} ms"
    work = f"work at most {status.work_max_us / 1e3:.2f} ms"
    table.add_row("loop", f"{status.ticks} ticks, {missed}, {work}")
    if (senses_s := sensing_for_s(status)) is not None:
        table.add_row("sensing", f"every joint, for {clock(senses_s)}")
    if words := lost_samples(status):
        table.add_row("samples", Text(words, "yellow"))
    table.add_row("real time", _grants(status.realtime))
    uptime = clock(status.uptime_s)
    readers = "1 reader" if status.readers == 1 else f"{status.readers} readers"
    table.add_row("process", f"pid {status.pid}, up {uptime}, {readers}")
    if socket is not None:
        table.add_row("socket", Text(str(socket)))
    frame = Table.grid()
    frame.add_row(table)
    frame.add_row("")
    frame.add_row(_joints(status))
    if status.sensitivity is not None:
        frame.add_row("")
        lines, levels = sensitivity_lines(status.sensitivity), _levels(status)
        both = [f"{left}  {right}" for left, right in zip(lines, levels, strict=False)]
        frame.add_row(Text("\n".join([*both, *lines[len(both) :], SHARE])))
    return frame


def _hand(table: Table, status: Status) -> None:
    """Add the rows on guide and payload."""
    if status.guide.guides:
        table.add_row("guide", Text(str(status.guide)))
    if status.hand:
        table.add_row("payload", Text(payload_in_words(status)))
    if status.recognised:
        table.add_row("", Text(status.recognised, "yellow"))


def _changed(status: Status) -> str:
    """Words on files that differ from those in use, and when they are taken up."""
    if status.not_taken_up:
        return f"not taken up: {status.not_taken_up}"
    names = ", ".join(status.changed)
    return f"changed since it was read: {names}; taken up before the drives are enabled"


def _permission(status: Status) -> Text:
    """Words on whether the arm is armed, by which user, and for how long."""
    if not status.armed:
        ended = f": {status.disarmed}{_ago(status, status.disarmed_s)}" if status.disarmed else ""
        return Text(f"not armed{ended}")
    text = Text("armed", "bold bright_cyan")
    if permit := status.permit:
        user = user_name(permit.uid)
        behalf = f" on behalf of {permit.on_behalf_of}" if permit.on_behalf_of else ""
        more = "" if permit.detached else ", while its program renews it"
        left = in_words(permit.left_s)
        text.append(f" by {user} (pid {permit.pid}){behalf} for another {left}{more}", "not bold")
    return text


def _arming(status: Status) -> tuple[str, Text]:
    """Label and words on the checks before arming; for an armed arm, only checks that would refuse
    arming again."""
    if status.armed:
        against = [f"{check.name}: {check.text}" for check in status.checks if not check.passed]
        return "to arm again", Text("\n".join(against) or "all checks pass")
    lines = [Text(str(check), "yellow") for check in status.checks if not check.passed]
    if passed := [check.name for check in status.checks if check.passed]:
        lines.append(Text(f"passed  {', '.join(passed)}"))
    return "arming needs", Text("\n").join(lines)


def _grants(grants: list[Grant]) -> Text:
    """Real-time settings that were achieved, then a line for each that was not."""
    achieved = ", ".join(grant.text for grant in grants if grant.achieved)
    lacking = [Text(grant.text, "yellow") for grant in grants if not grant.achieved]
    return Text("\n").join([*([Text(achieved)] if achieved else []), *lacking])


def _cause(status: Status) -> str:
    """Cause of the mode, and how long ago it occurred, as it may be over."""
    return status.cause if status.since_s is None else status.cause + _ago(status, status.since_s)


def _ago(status: Status, then_s: float) -> str:
    """Time since a moment, in brackets."""
    ago_s = max(status.uptime_s - then_s, 0.0)
    units = ((7200.0, 3600.0, "h"), (120.0, 60.0, "min"))
    size, unit = next(((size, unit) for least, size, unit in units if ago_s >= least), (1.0, "s"))
    return f" ({ago_s // size:.0f} {unit} ago)"


def _levels(status: Status) -> list[str]:
    """Table of configured contact levels, their lower bounds and the shares in force."""
    rows = zip(status.contact, status.least, status.level_share, strict=False)
    lines = [f"{level:7.2f} Nm {least:5.2f} Nm {share:6.0%}" for level, least, share in rows]
    return ["configured    least  share", *lines] if lines else []


def _trajectory(trajectory: Trajectory, stream: StreamState | None) -> str:
    if not trajectory.name:
        return "none configured: `contactctl start FILE.csv` runs one"
    words = {
        "ready": "begins with `contactctl start`",
        "running": "runs",
        "interrupted": "continues once the arm is released",
        "paused": "paused: `contactctl start` continues it, `contactctl stop` discards it",
    }
    end = "" if trajectory.duration_s is None else f" of {trajectory.duration_s:.1f}"
    begun = trajectory.time_s > 0.0 or trajectory.duration_s is not None
    at = "" if trajectory.state == "ready" or not begun else f" at {trajectory.time_s:.1f}{end} s"
    if trajectory.attended:
        words["paused"] = "paused, and discarded when the program that started it ends"
    if stream is not None:
        words["paused"] = "paused: `contactctl start` continues it"
        words["interrupted"] = f"{AFTER_CONTACT[stream.after_contact]} once the arm is released"
    return f"{trajectory.name}{at}: {words[trajectory.state]}"


def _joints(status: Status) -> RenderableType:
    table = Table(box=None, padding=(0, 1), header_style="bold")
    for name in ("joint", "rad", "Nm", "of", "side", "age", "drive"):
        justify = "right" if name in {"rad", "Nm", "of", "age"} else "left"
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    # Before the first samples, nothing but the joints' names is known.
    rows = zip(
        status.joints,
        status.link_position,
        status.residual,
        status.threshold,
        status.side,
        status.age_ticks,
        status.drives,
        strict=False,
    )
    for joint, position, residual, threshold, side, age, drive in rows:
        table.add_row(
            Text(joint),
            f"{position:+.3f}",
            Text(f"{residual:+.2f}", residual_style(residual, threshold)),
            f"{threshold:.2f}",
            Text(side, SIDE_STYLES.get(side, "")),
            Text(str(age), "yellow" if age else "dim"),
            drive_text(drive),
        )
    if not table.row_count:
        return Text(f"{len(status.joints)} joints, no samples from the drives yet", "yellow")
    return table
