"""Pictures of what was identified, after the paper's figures 5, 6 and 7. Needs matplotlib, which
the daemon does without: where it is not installed, there are none."""

from pathlib import Path
from typing import Any

import numpy as np

from estimator.identification.friction import Reconstruction
from estimator.identification.log import MotionLog


def _figure(rows: int, columns: int) -> tuple[Any, Any, Any]:
    import matplotlib as mpl  # noqa: PLC0415 - slow, and perhaps not there

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    size = (5.0 * columns, 2.2 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    return plt, figure, axes


def plot_gap(log: MotionLog, joint: int, half_gap: float, path: Path) -> Path | None:
    """phi over time, and how long it was where (figure 5)."""
    try:
        plt, figure, axes = _figure(1, 2)
    except ImportError:
        return None
    position = log.motor_position
    if position is None:
        steps = np.diff(log.time_s, prepend=log.time_s[0])
        velocity = log.motor_velocity[:, joint]
        theta = np.cumsum((velocity - velocity.mean()) * steps)
    else:
        theta = position[:, joint]
    phi = 1e3 * (log.link_position[:, joint] - theta)
    left, right = axes[0]
    left.plot(log.time_s - log.time_s[0], phi, lw=0.8)
    left.set(xlabel="time [s]", ylabel="phi = q - theta [mrad]", title=log.joints[joint])
    right.hist(phi, bins=80, orientation="horizontal")
    right.set(xlabel="samples")
    if np.isfinite(half_gap):
        middle = 0.5 * (np.percentile(phi, 2) + np.percentile(phi, 98))
        for side in (-1, 1):
            for axis in (left, right):
                axis.axhline(middle + side * 1e3 * half_gap, color="C3", lw=0.8)
    return _saved(plt, figure, path)


def plot_friction(log: MotionLog, shown: Reconstruction, folder: Path) -> list[Path]:
    """The motion (figure 6), and r_nl with its reconstruction (figure 7), a row for each joint."""
    try:
        plt, figure, axes = _figure(log.n, 1)
    except ImportError:
        return []
    for i, axis in enumerate(axes[:, 0]):
        axis.plot(log.time_s - log.time_s[0], log.link_position[:, i], lw=0.8)
        axis.set(ylabel="q [rad]", title=log.joints[i])
    axes[-1, 0].set_xlabel("time [s]")
    paths = [_saved(plt, figure, folder / "motion.png")]
    plt, figure, axes = _figure(log.n, 1)
    for i, axis in enumerate(axes[:, 0]):
        time_s = shown.time_s - shown.time_s[0]
        axis.plot(time_s, shown.r_nl[:, i], "C0", lw=0.8, label="r_nl")
        axis.plot(time_s, shown.reconstructed[:, i], "C3", lw=0.8, label="reconstructed")
        axis.set(ylabel="[Nm]", title=log.joints[i])
    axes[0, 0].legend(fontsize=8)
    axes[-1, 0].set_xlabel("time [s]")
    return [*paths, _saved(plt, figure, folder / "friction.png")]


def _saved(plt: Any, figure: Any, path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path
