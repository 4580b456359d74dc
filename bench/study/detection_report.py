"""Report of `bench.detection` for people: two tables and a picture."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from bench.study.detection_score import Score
from bench.study.world import Law
from daemon.config.schema import Configuration

mpl.use("Agg")


# Both tables fit into 80 columns.
NARROW: dict[str, Any] = {"box": None, "padding": (0, 1, 0, 0), "title_justify": "left"}


def table(friction: str, by_name: dict[str, Score], title: str) -> Table:
    """One row per residual; delays as p50/p95."""
    shown = Table(title=f"{friction} friction: {title}", header_style="bold", **NARROW)
    shown.add_column("residual", no_wrap=True)
    for heading in ("alarms", "per h", "delay\n[ms]", "through\ngap", "at\nrest"):
        shown.add_column(heading, justify="right", no_wrap=True)
    for heading in ("missed\nmoving", "missed\nat rest"):
        shown.add_column(heading, justify="right", no_wrap=True)
    for name, s in by_name.items():
        pairs = (s.delay_ms, s.delay_travel_ms, s.delay_rest_ms)
        shown.add_row(
            name,
            f"{s.alarms}",
            f"{s.alarms_per_hour:.0f}",
            *("-" if math.isnan(p50) else f"{p50:.0f}/{p95:.0f}" for p50, p95 in pairs),
            f"{s.missed_moving}/{s.tried_moving}",
            f"{s.missed_rest}/{s.tried_rest}",
        )
    return shown


def joint_table(friction: str, by_name: dict[str, Score], c: Configuration) -> Table:
    """Torques per joint [Nm]."""
    shown = Table(title=f"{friction} friction: joints [Nm]", header_style="bold", **NARROW)
    shown.add_column("", no_wrap=True)
    for i in range(len(c.joints)):
        shown.add_column(str(i + 1), justify="right", no_wrap=True)
    shown.add_row("configured threshold", *(f"{j.thresholds.contact:.2f}" for j in c.joints))
    in_force = next(iter(by_name.values())).in_force_nm
    shown.add_row("in force in motion, median", *(_number(x) for x in in_force))
    hidden = next(iter(by_name.values())).hidden_rest_nm
    shown.add_row("hidden by friction at rest", *(_number(x) for x in hidden))
    may_hide = next(iter(by_name.values())).stiction_rest_nm
    shown.add_row("may be hidden by it", *(_number(x) for x in may_hide))
    rows = (
        ("lowest quiet threshold", "quiet_nm"),
        ("smallest step, in motion", "smallest_moving_nm"),
        ("smallest step, while it turns", "smallest_turning_nm"),
        ("smallest step, at rest", "smallest_rest_nm"),
        ("rms error, engaged", "rms_nm"),
    )
    for title, field in rows:
        shown.add_row("")
        shown.add_row(title, style="bold")
        for name, s in by_name.items():
            shown.add_row(f"  {name}", *(_number(x) for x in getattr(s, field)))
    return shown


def _number(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.2f}"


def picture(found: Mapping[Law, dict[str, Score]], c: Configuration, path: Path) -> Path:
    """Thresholds, smallest steps and delays of every residual, a row of panels per friction."""
    figure = Figure(figsize=(16, 4.5 * len(found)), layout="constrained")
    panels = figure.subplots(len(found), 3, squeeze=False)
    for row, (friction, by_name) in zip(panels, found.items(), strict=True):
        _bars(row[0], {n: s.quiet_nm for n, s in by_name.items()}, c)
        row[0].set_title(f"{friction}: lowest threshold without an alarm [Nm]")
        _bars(row[1], {n: s.smallest_moving_nm for n, s in by_name.items()}, c)
        row[1].set_title(f"{friction}: smallest step felt in motion at it [Nm]")
        _delays(row[2], by_name, 1000.0 * math.log(2.0) / c.estimator.gain)
        row[2].set_title(f"{friction}: delay to twice the threshold [ms]")
    panels[0][0].legend(fontsize=8)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def _bars(axes: Any, values: dict[str, Any], c: Configuration) -> None:
    """One group per joint, one bar per residual, the configured threshold as a line."""
    width = 0.8 / len(values)
    joints = np.arange(len(c.joints))
    for k, (name, row) in enumerate(values.items()):
        axes.bar(joints - 0.4 + (k + 0.5) * width, row, width, label=name)
    contact = [joint.thresholds.contact for joint in c.joints]
    axes.hlines(contact, joints - 0.45, joints + 0.45, colors="black", label="configured threshold")
    axes.set_xticks(joints, [joint.name for joint in c.joints], rotation=30, ha="right")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(axis="y", alpha=0.4)


def _delays(axes: Any, by_name: dict[str, Score], filter_ms: float) -> None:
    """p50 to p95, without and with the gap to cross."""
    for k, s in enumerate(by_name.values()):
        for offset, (low, high), color in (
            (-0.15, s.delay_ms, "tab:blue"),
            (0.15, s.delay_travel_ms, "tab:orange"),
        ):
            axes.plot([low, high], [k + offset] * 2, "o-", color=color)
    axes.plot([], [], "o-", color="tab:blue", label="p50 to p95, no gap to cross")
    axes.plot([], [], "o-", color="tab:orange", label="p50 to p95, through the gap")
    axes.axvline(filter_ms, color="black", linestyle=":", label="ln 2 / K")
    axes.set_yticks(range(len(by_name)), list(by_name))
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.legend(fontsize=8)
