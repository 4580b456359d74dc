"""Plots of identification results, after figures 5, 6 and 7 of the paper.

They need matplotlib, which the daemon does not depend on; without it no plots are made.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from common.arrays import Vector
from identification.direct_friction import Law, Point
from identification.friction import Reconstruction
from identification.gap import positions
from identification.motion_log import MotionLog


def _figure(rows: int, columns: int) -> tuple[Any, Any, Any]:
    import matplotlib as mpl  # noqa: PLC0415 - slow, and perhaps not there

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    size = (5.0 * columns, 2.2 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    return plt, figure, axes


def _curve(axis: Any, time_s: Vector, values: Vector, *style: str, **more: Any) -> None:
    """Draw a curve that is interrupted where samples are missing."""
    steps = np.diff(time_s, prepend=time_s[0])
    values = np.where(steps > 3.0 * np.median(steps), np.nan, values)
    axis.plot(time_s - time_s[0], values, *style, lw=0.8, **more)


def plot_gap(log: MotionLog, joint: int, half_gap: float, path: Path) -> list[Path]:
    """Plot phi over time with its histogram (figure 5). Returns the files written."""
    try:
        plt, figure, axes = _figure(1, 2)
    except ImportError:
        return []
    q, theta = positions(log, joint)
    phi = 1e3 * (q - theta)
    left, right = axes[0]
    _curve(left, log.time_s, phi)
    left.set(xlabel="time [s]", ylabel="phi = q - theta [mrad]", title=log.joints[joint])
    # Of one encoder behind both columns only rounding is left, too little for bins.
    span = max(float(np.ptp(phi)), 1e-3)
    bins = np.linspace(-0.5, 0.5, 81) * span + 0.5 * (phi.min() + phi.max())
    right.hist(phi, bins=bins, orientation="horizontal")
    right.set(xlabel="samples")
    if np.isfinite(half_gap):
        middle = 0.5 * (np.percentile(phi, 2) + np.percentile(phi, 98))
        for side in (-1, 1):
            for axis in (left, right):
                axis.axhline(middle + side * 1e3 * half_gap, color="C3", lw=0.8)
    return [_saved(plt, figure, path)]


def plot_friction(log: MotionLog, shown: Reconstruction, folder: Path) -> list[Path]:
    """Plot phi (figure 5), the motion (figure 6), and r_nl with its reconstruction (figure 7), one
    row per joint. Returns the files written."""
    paths = []
    for name, label, time_s, values in (
        ("phi.png", "phi [mrad]", shown.time_s, 1e3 * shown.phi),
        ("motion.png", "q [rad]", log.time_s, log.link_position),
    ):
        try:
            plt, figure, axes = _figure(log.n, 1)
        except ImportError:
            return []
        for i, axis in enumerate(axes[:, 0]):
            _curve(axis, time_s, values[:, i])
            axis.set(ylabel=label, title=log.joints[i])
        axes[-1, 0].set_xlabel("time [s]")
        paths.append(_saved(plt, figure, folder / name))
    plt, figure, axes = _figure(log.n, 1)
    for i, axis in enumerate(axes[:, 0]):
        _curve(axis, shown.time_s, shown.r_nl[:, i], "C0", label="r_nl")
        _curve(axis, shown.time_s, shown.reconstructed[:, i], "C3", label="reconstructed")
        axis.set(ylabel="[Nm]", title=log.joints[i])
    axes[0, 0].legend(fontsize=8)
    axes[-1, 0].set_xlabel("time [s]")
    return [*paths, _saved(plt, figure, folder / "friction.png")]


def plot_direct(shown: Mapping[str, tuple[Law, list[Point]]], folder: Path) -> list[Path]:
    """Plot friction over load and over speed, one row per joint: points, coloured by the other of
    the two, and the friction law at three values of the other. Returns the files written."""
    try:
        plt, figure, axes = _figure(len(shown), 2)
    except ImportError:
        return []
    for (name, (law, found)), row in zip(shown.items(), axes, strict=True):
        points = np.array([(abs(p.load), p.speed, p.friction, p.scatter) for p in found]).T
        for k, (axis, unit) in enumerate(zip(row, ("rad/s", "Nm"), strict=True)):
            x, other = points[k], points[1 - k]
            at, three = np.linspace(0.0, x.max(), 200)[1:], np.linspace(other.min(), other.max(), 3)
            colour = plt.Normalize(three[0], 1.1 * three[2])
            axis.errorbar(x, points[2], points[3], fmt="none", color="0.6", lw=0.8)
            axis.scatter(x, points[2], 9, plt.cm.viridis(colour(other)), zorder=3)
            for one in three:
                friction, half = np.array([law.at(*((a, one)[:: 1 - 2 * k])) for a in at]).T
                style = {"color": plt.cm.viridis(colour(one)), "lw": 0.8}
                axis.plot(at, friction, label=f"law, {one:.2f} {unit}", **style)
                axis.fill_between(at, friction - half, friction + half, alpha=0.2, **style)
            axis.legend(fontsize=6)
        row[0].set(xlabel="load [Nm]", ylabel="friction [Nm]", title=name)
        row[1].set(xlabel="speed [rad/s]")
    return [_saved(plt, figure, folder / "friction-direct.png")]


def _saved(plt: Any, figure: Any, path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path
