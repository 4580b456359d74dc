"""Report of `bench.detection` for people: two tables."""

import math

from rich.table import Table

from bench.report import NARROW, joints_table
from bench.study.detection_score import Score
from daemon.config.schema import Configuration


def table(friction: str, by_name: dict[str, Score], title: str) -> Table:
    """One row per residual; delays as p50/p95."""
    shown = Table(title=f"{friction} friction: {title}", header_style="bold", **NARROW)
    shown.add_column("residual", no_wrap=True)
    times = ("delay\n[ms]", "through\ngap", "at\nrest")
    for heading in ("alarms", "per h", *times, "missed\nmoving", "missed\nat rest"):
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
    shown = joints_table(f"{friction} friction: joints [Nm]", len(c.joints))
    first = next(iter(by_name.values()))
    for title, values in (
        ("configured threshold", [j.thresholds.contact for j in c.joints]),
        ("in force in motion, median", first.in_force_nm),
        ("hidden by friction at rest", first.hidden_rest_nm),
        ("may be hidden by it", first.stiction_rest_nm),
    ):
        shown.add_row(title, *map(_number, values))
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
            shown.add_row(f"  {name}", *map(_number, getattr(s, field)))
    return shown


def _number(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.2f}"
