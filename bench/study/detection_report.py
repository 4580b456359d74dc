"""Report of `bench.detection` for people: two tables."""

import math
from typing import Any

from rich.table import Table

from bench.study.detection_score import Score
from daemon.config.schema import Configuration

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
