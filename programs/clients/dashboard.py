"""Live dashboard as rich renderables.

They depend on messages alone: nothing here reads a socket, a clock or a terminal. `Dashboard` fits
into 100 x 30 characters, and into 80 x 24 with narrower bars.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from programs.clients.nearest_pair import nearest_pair_words
from programs.clients.sensing import not_sensing, sensing_for_s
from programs.clients.stream_words import AFTER_CONTACT, quality_in_words
from programs.clients.styles import (
    MODE_STYLES,
    SIDE_STYLES,
    clock,
    drive_text,
    not_seen_to_stand,
    residual_style,
)

SHOWN_LAG_S = 0.5
SHOWN_SILENCE_S = 0.5
WINDOW_TICKS = 1000
EVENTS_KEPT = 12
WIDE = 96  # width from which on bars are wide and drive states are shown


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of the last WINDOW_TICKS ticks and the last events."""

    lateness_p50_us: float = 0.0
    lateness_max_us: float = 0.0
    work_max_us: float = 0.0
    events: tuple[tuple[float, str, str], ...] = ()  # time [s], kind, text; newest last


@dataclass(slots=True)
class History:
    """Bounded history of timing and events."""

    _timing: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=WINDOW_TICKS))
    _events: deque[tuple[float, str, str]] = field(
        default_factory=lambda: deque(maxlen=EVENTS_KEPT)
    )

    def add(self, state: State) -> None:
        """Add the timing and the events of one tick."""
        self._timing.append((state.timing.lateness_us, state.timing.work_us))
        self._events.extend((state.time_s, event.kind, event.text) for event in state.notices)

    def summary(self) -> Summary:
        """Summary so far; all zero before the first State."""
        if not self._timing:
            return Summary()
        lateness = sorted(late for late, _ in self._timing)
        return Summary(
            lateness_p50_us=lateness[len(lateness) // 2],
            lateness_max_us=lateness[-1],
            work_max_us=max(work for _, work in self._timing),
            events=tuple(self._events),
        )


@dataclass(slots=True)
class Lag:
    """Lag of the States that are read behind the daemon: the increase of the offset between the two
    clocks over its least value. A reader slowed by a busy computer or terminal shows the past."""

    _least: float = math.inf

    def of(self, now_s: float, time_s: float) -> float:
        """Lag [s] of a State with the daemon's time `time_s`, read at `now_s` of our clock."""
        offset = now_s - time_s
        self._least = min(self._least, offset)
        return offset - self._least


@dataclass(frozen=True, slots=True)
class Dashboard:
    """One frame of `contactctl watch`, laid out for the console that prints it."""

    snapshot: Snapshot
    state: State
    summary: Summary
    lag_s: float = 0.0  # of the display behind the daemon
    silent_s: float = 0.0  # time since the last State

    def _not_live(self) -> Text | None:
        if self.silent_s < SHOWN_SILENCE_S:
            return None
        text = f" NOT LIVE: no data for {self.silent_s:.1f} s; all below is from before"
        return Text(text, "bold red")

    def _lagging(self) -> Text | None:
        if self.lag_s < SHOWN_LAG_S:
            return None
        text = f" display is {self.lag_s:.1f} s old: the terminal or this computer is too slow"
        return Text(text, "bold yellow")

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        wide = options.max_width >= WIDE
        state = self.state
        yield _headline(state, self.snapshot.quiet_s, stale=self.silent_s >= SHOWN_SILENCE_S)
        doubts = [
            self._not_live(),
            self._lagging(),
            not_seen_to_stand(state, " "),
            self._not_sensing(),
            Text(f" near: {nearest_pair_words(state.near)}") if state.near else Text(),
            Text(f" guide for a hand: {state.guide}") if state.guide else Text(),
        ]
        doubt_lines = [
            line for doubt in doubts if doubt for line in doubt.wrap(console, options.max_width)
        ]
        yield from doubt_lines
        yield Text(f" {state.cause}", no_wrap=True, overflow="crop")
        if stream := state.stream:
            quality = quality_in_words(stream, state.link_position)
            yield Text(f" stream {stream.phase}: {quality}", no_wrap=True, overflow="crop")
        yield Text()
        yield self._joints(wide, options.ascii_only)
        yield Text()
        yield self._loop(wide)
        rows_left = (options.height or console.height) - len(state.setpoint) - 7 - len(doubt_lines)
        rows_left -= state.stream is not None
        if state.flags:
            flags = f" estimator: {'; '.join(state.flags)}"
            yield Text(flags, "yellow", no_wrap=True, overflow="crop")
            rows_left -= 1
        for time_s, kind, text in list(self.summary.events)[-max(rows_left, 1) :]:
            style = {"fault": "bold red", "contact": "bright_cyan"}.get(kind, "")
            line = Text(f" {time_s:9.2f} s  {kind:8}", "dim", no_wrap=True, overflow="crop")
            yield line.append(text, style)

    def _joints(self, wide: bool, ascii_only: bool) -> Table:
        state = self.state
        beside = next(iter(state.beside), None)
        table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
        table.add_column(" joint", no_wrap=True, overflow="crop")
        table.add_column("rad", justify="right", no_wrap=True, overflow="crop")
        table.add_column("gap", no_wrap=True, overflow="crop")
        table.add_column("side", no_wrap=True, overflow="crop")
        table.add_column("residual", no_wrap=True, overflow="crop")
        table.add_column("Nm", justify="right", no_wrap=True, overflow="crop")
        table.add_column("of", justify="right", no_wrap=True, overflow="crop")
        if beside:
            table.add_column(beside, justify="right", no_wrap=True, style="dim")
        if wide:
            table.add_column("drive", no_wrap=True, overflow="crop")
        for i, joint in enumerate(self.snapshot.joints):
            residual, threshold = state.residual[i], state.threshold[i]
            touched = "bold bright_cyan" if joint == state.touched_link else ""
            row: list[RenderableType] = [
                Text(f" {joint}", touched if state.fresh[i] else "dim"),
                f"{state.link_position[i]:+.3f}",
                gap_bar(state.phi[i], self.snapshot.half_gap[i], 4 if wide else 3),
                Text(state.side[i], SIDE_STYLES.get(state.side[i], "")),
                residual_bar(residual, threshold, 7 if wide else 5, ascii_only),
                Text(f"{residual:+.2f}", residual_style(residual, threshold)),
                f"{threshold:.2f}",
            ]
            if beside:
                row.append(f"{state.beside[beside][i]:+.2f}")
            if wide:
                row.append(drive_text(state.drives[i]))
            table.add_row(*row)
        return table

    def _not_sensing(self) -> Text:
        words = not_sensing(self.state, self.snapshot.joints)
        return Text(f" {words}" if words else "", "bold red")

    def _loop(self, wide: bool) -> Text:
        summary, timing = self.summary, self.state.timing
        period_us = 1e6 * self.snapshot.period_s
        late = "red" if summary.lateness_max_us > 0.2 * period_us else ""
        line = Text(" loop  late p50 ", no_wrap=True, overflow="crop")
        line.append(f"{summary.lateness_p50_us / 1e3:.2f}, ")
        line.append(f"max {summary.lateness_max_us / 1e3:.2f} ms", late)
        busy = "red" if summary.work_max_us > period_us else ""
        line.append("   work max ").append(f"{summary.work_max_us / 1e3:.2f} ms", busy)
        line.append(f" of {period_us / 1e3:.0f}   missed ")
        line.append(str(timing.missed), "red" if timing.missed else "")
        if wide and (senses_s := sensing_for_s(self.state)) is not None:
            line.append(f"   all sense {clock(senses_s)}", "dim")
        return line


def gap_bar(phi: float, half_gap: float, half_width: int) -> Text:
    """Bar `[--o--|-----]` with phi between the edges of its gap; o on an edge if beyond it."""
    if half_gap <= 0.0:
        return Text("no gap".center(2 * half_width + 3), "dim")
    cells = ["[", *("-" * half_width), "|", *("-" * half_width), "]"]
    reach = half_width + 1
    if abs(phi) >= half_gap:
        at = reach if phi > 0.0 else -reach
    else:
        at = round(phi / half_gap * half_width)
    bar = Text("".join(cells), "dim")
    bar.right_crop(len(cells) - (reach + at))
    bar.append("o", "bold cyan" if abs(at) < reach else "bold")
    return bar.append("".join(cells[reach + at + 1 :]), "dim")


def residual_bar(residual: float, threshold: float, half_width: int, ascii_only: bool) -> Text:
    """Bar from the middle to the residual; `:` marks the thresholds, half-way to either end."""
    full = "#" if ascii_only else "█"
    middle = "|" if ascii_only else "│"
    mark = ":" if ascii_only else "┊"
    scale = 2.0 * threshold if threshold > 0.0 else 1.0
    filled = min(half_width, round(abs(residual) / scale * half_width))
    marks = [mark if i == round(half_width / 2) else " " for i in range(1, half_width + 1)]
    side = full * filled + "".join(marks[filled:])
    other = "".join(marks)
    style = residual_style(residual, threshold)
    bar = Text()
    if residual < 0.0:
        return bar.append(side[::-1], style).append(middle).append(other, "dim")
    return bar.append(other[::-1], "dim").append(middle).append(side, style)


def last_known(state: State) -> str:
    """Words on the last known state of an unreachable daemon, with advice if the arm may move."""
    text = f"last known: {state.mode}{', armed' if state.armed else ''}"
    if state.mode == Mode.OFF and not state.unproved:
        return text
    return f"{text}; use the emergency stop if the arm moves"


def _headline(state: State, quiet_s: float, *, stale: bool) -> Text:
    line = Text(no_wrap=True, overflow="crop")
    if stale:
        line.append(f" was {state.mode.upper()} ", "white on grey30")
        line.append(f"  {'was armed' if state.armed else 'was not armed'}", "dim")
        return line.append(f"   {clock(state.time_s)}   tick {state.tick}", "dim")
    line.append(f" {state.mode.upper():^10} ", MODE_STYLES.get(state.mode, "reverse"))
    line.append("  ")
    line.append(*(("ARMED", "bold bright_cyan") if state.armed else ("not armed", "dim")))
    line.append(f"   {clock(state.time_s)}   tick {state.tick}")
    if state.mode in (Mode.ADMITTANCE, Mode.RETRACTING):
        then = "continues" if state.moving else "holds"
        if state.moving and state.stream is not None:
            then = AFTER_CONTACT[state.stream.after_contact]
        left_s = max(quiet_s - state.quiet_s, 0.0)
        line.append(f"   {then} in {left_s:.1f} s if untouched", "bright_cyan")
    elif state.mode == Mode.RETURNING:
        line.append("   returns to its trajectory", "bright_cyan")
    elif state.moving:
        line.append("   trajectory runs")
    return line
