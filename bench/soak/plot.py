"""Picture of a soak's samples over time, one row of panels per figure, one column per part."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from bench.soak.record import BOUNDS, Part
from bench.soak.trend import second_half

WHOLE, JUDGED, TREND = "#9db4c8", "#1f4e79", "#d1495b"


def plot(parts: Sequence[Part], path: Path) -> Path:
    """Write a PNG; returns its path."""
    rows = [name for name in BOUNDS if any(name in part.samples for part in parts)]
    with mpl.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(4.6 * len(parts), 1.45 * len(rows)), layout="constrained")
        panels = figure.subplots(len(rows), len(parts), squeeze=False)
        for column, part in enumerate(parts):
            trends = {each.name: each for each in part.trends()}
            unit, scale = ("h", 3600.0) if part.seconds > 5400.0 else ("min", 60.0)
            for row, name in enumerate(rows):
                axes = panels[row][column]
                if row == 0:
                    axes.set_title(part.name, loc="left", fontweight="bold")
                if name not in part.samples:
                    axes.set_axis_off()
                    continue
                times = [t / scale for t in part.times_s]
                axes.plot(times, part.samples[name], color=WHOLE, linewidth=0.8)
                settled_s, values = part.settled(name)
                late, each = second_half(settled_s), trends[name]
                begin, end = settled_s[late][0] / scale, settled_s[-1] / scale
                axes.plot([t / scale for t in settled_s[late]], values[late], color=JUDGED, lw=0.8)
                line = [each.median - each.growth / 2.0, each.median + each.growth / 2.0]
                axes.plot([begin, end], line, color=TREND, linewidth=1.6)
                # What may be a trend shall not look like one that is none.
                middle = max(abs(each.median), each.allowed)
                low, high = min(part.samples[name]), max(part.samples[name])
                axes.set_ylim(
                    min(low, each.median - 0.1 * middle), max(high, each.median + 0.1 * middle)
                )
                axes.set_ylabel(f"{name}\n[{each.unit}]" if each.unit else name)
            panels[-1][column].set_xlabel(f"time [{unit}]")
        path.parent.mkdir(exist_ok=True)
        figure.savefig(path, dpi=130)
    return path
