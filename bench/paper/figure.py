"""Parts that all figures share: pictures, a table of numbers, targets; and their drawing."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.report import Target
from bench.study.contacts import count_contacts
from bench.study.recording import Recording
from common.arrays import Vector

PIXELS_PER_INCH = 100
COLOURS = {
    "backlash": "tab:blue",
    "classical": "tab:red",
    "classical+friction": "tab:orange",
    "kalman": "tab:green",
}
"""The paper's blue and red, and the rivals that it does not have."""
LINK, MOTOR = "0.1", "tab:purple"
BAND = "0.88"
STYLE: dict[str, Any] = {"linewidth": 1.1}
BOUNCE_S = 0.5  # the link comes back into its gap after an impact: one crossing
THRESHOLD: dict[str, Any] = {"color": "0.25", "linestyle": (0, (4, 3)), "linewidth": 0.8}


@dataclass(frozen=True, slots=True)
class Made:
    """One figure of the paper, made again."""

    table: dict[str, Any]
    targets: list[Target]
    pictures: dict[str, Figure]  # by file name, without its ending


def canvas(width: float, height: float, title: str) -> Figure:
    """An empty picture [inches] that keeps its labels apart by itself."""
    figure = Figure(figsize=(width, height), dpi=PIXELS_PER_INCH, layout="constrained")
    figure.suptitle(title, fontsize=11)
    return figure


def save(figure: Figure, path: Path | BinaryIO) -> None:
    """Write a picture as PNG, the same bytes for the same picture."""
    compact = {"compress_level": 9}
    figure.savefig(path, format="png", metadata={"Software": None}, pil_kwargs=compact)


def finish(axes: Axes, ylabel: str, *, last: bool = True) -> None:
    """Labels with units, a light grid, and the time below."""
    axes.set_ylabel(ylabel, fontsize=9)
    axes.grid(color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.0)
    axes.tick_params(labelsize=8, labelbottom=last)
    if last:
        axes.set_xlabel("time [s]", fontsize=9)


def draw_thresholds(axes: Axes, recording: Recording, joint: int) -> None:
    """Both signs of the contact threshold that was in force."""
    level = recording.threshold[:, joint]
    axes.plot(recording.time_s, level, label="threshold in force", **THRESHOLD)
    axes.plot(recording.time_s, -level, **THRESHOLD)


def draw_residual(axes: Axes, recording: Recording, name: str, joint: int, **style: Any) -> None:
    """One residual of one joint in its colour."""
    values = recording.residuals[name][:, joint]
    style = {"color": COLOURS[name], "label": name, **STYLE, **style}
    axes.plot(recording.time_s, values, **style)


def crossings(recording: Recording, joint: int) -> list[tuple[float, float]]:
    """Beginning and end [s] of each time that the link was free, with the bounces after it."""
    free: list[tuple[float, float]] = []
    for in_gap, begin, end in runs(recording.true_in_gap[:, joint], recording.time_s):
        if in_gap and free and begin - free[-1][1] < BOUNCE_S:
            free[-1] = (free[-1][0], end)
        elif in_gap:
            free.append((begin, end))
    return free


def draw_crossings(axes: Axes, recording: Recording, joint: int) -> None:
    """Bands where the link was free in its gap."""
    for i, (begin, end) in enumerate(crossings(recording, joint)):
        axes.axvspan(begin, end, color=BAND, lw=0, label="_" * bool(i) + "in the gap")


def runs(rows: NDArray[Any], time_s: Vector) -> Iterator[tuple[Any, float, float]]:
    """(value, begin, end) of every stretch of equal rows."""
    edges = [0, *(np.flatnonzero(rows[1:] != rows[:-1]) + 1).tolist(), len(rows) - 1]
    for begin, end in pairwise(edges):
        if begin < end:
            yield rows[begin], float(time_s[begin]), float(time_s[end])


def residual_table(recording: Recording, levels: list[float]) -> dict[str, dict[str, Any]]:
    """Largest |r| and contacts per joint, by residual, against the plant's true torque.

    levels: torque [Nm] per joint that a contact must reach to be missed.
    """
    table = {}
    moving = recording.threshold < 1.1 * np.array(contact_levels(recording))
    for name, values in recording.residuals.items():
        counts = count_contacts(
            recording.true_torque,
            recording.thresholded(name),
            levels,
            recording.configuration.period_s,
        )
        size = np.abs(values)
        table[name] = {
            "largest_nm": _rounded(size.max(axis=0)),
            "largest_in_motion_nm": _rounded(np.where(moving, size, 0.0).max(axis=0)),
            "largest_share_of_threshold": _rounded((size / recording.threshold).max(axis=0)),
            "detected": [count.detected for count in counts],
            "missed": [count.missed for count in counts],
            "false": [count.false for count in counts],
            "delays_ms": [[round(1e3 * d, 1) for d in count.delays_s] for count in counts],
        }
    return table


def contact_levels(recording: Recording) -> list[float]:
    """The configured contact thresholds [Nm], not raised."""
    return [joint.thresholds.contact for joint in recording.configuration.joints]


def _rounded(values: Vector) -> list[float]:
    return [round(float(value), 3) for value in values]
