"""Display of the identification: tables, and a live histogram of phi."""

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from identification.gap_result import CROSSINGS, GapResult
from programs.identify.overview import COLUMNS, Overview
from programs.identify.step import Outcome

_BARS = " ▁▂▃▄▅▆▇█"
_WIDTH = 64


def print_outcome(console: Console, outcome: Outcome, width: int) -> None:
    """Print one row per joint, with names padded to `width`, and below it reasons and notes."""
    table = Table(box=None, pad_edge=False, show_header=len(outcome.lines) > 1)
    for column, least in (("joint", width), ("verdict", None), ("figures", None)):
        table.add_column(column, overflow="fold", min_width=least)
    for line in outcome.lines:
        style = "green" if line.good else "red"
        table.add_row(line.joint, Text(line.verdict, style=style), line.figures)
    console.print(table)
    for line in outcome.lines:
        if line.reason:
            console.print(f"  {line.joint}: {line.reason}", markup=False, highlight=False)
    for note in outcome.notes:
        console.print(f"note: {note}", markup=False, highlight=False)


def print_overview(console: Console, seen: Overview) -> None:
    """Print a table with a row per joint and a column per step, and the next command."""
    table = Table(box=None, pad_edge=False)
    for column in ("joint", *COLUMNS):
        table.add_column(column, overflow="fold")
    for name, row in seen.cells.items():
        cells = [
            Text(row[step].text, style="green" if row[step].good else "red") for step in COLUMNS
        ]
        table.add_row(name, *cells)
    console.print(table)
    for name, cell in seen.payloads.items():
        style = "green" if cell.good else "red"
        console.print(Text.assemble(f"payload {name}: ", (cell.text, style)))
    last = f"next: {seen.following}" if seen.following else "nothing is missing"
    console.print(last, markup=False, highlight=False, soft_wrap=True)


def histogram(phi: list[float], gap: GapResult | None) -> RenderableType:
    """Histogram of phi [rad] so far, with its range and the crossings counted."""
    values = 1e3 * np.array(phi)
    low, high = float(values.min()), float(values.max())
    counts, _ = np.histogram(values, bins=_WIDTH, range=(low, max(high, low + 0.1)))
    # Square roots make the few samples in transit visible beside the many at rest.
    heights = np.sqrt(counts / max(int(counts.max()), 1))
    bars = "".join(_BARS[round(h * (len(_BARS) - 1))] for h in heights)
    here = int((values[-1] - low) / max(high - low, 0.1) * (_WIDTH - 1))
    crossings = 0 if gap is None else gap.crossings
    about = "" if gap is None else f"{gap.verdict.value}: {gap.reason}"
    return Group(
        Text(f"phi from {low:+.1f} to {high:+.1f} mrad, range {high - low:.1f} mrad"),
        Text(bars, style="cyan"),
        Text(" " * here + "^ here"),
        Text(f"crossings {crossings} of at least {CROSSINGS}   {about}", style="dim"),
    )
