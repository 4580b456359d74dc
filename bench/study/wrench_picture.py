"""Picture of `bench.wrench`: error of the force over pose and over speed, by arm."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

EDGES: Final = {
    "condition of the jacobian": ("reach", np.array([1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 1e9])),
    "fastest joint [rad/s]": ("speed", np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 9.0])),
}


def draw(runs: Sequence[dict[str, Any]], path: Path) -> None:
    """Median and 95th percentile of the error of shown forces at the tool, ours along the seen
    directions and the pseudo-inverse's."""
    ticks = [f for one in runs for f in one["forces"] if f["acts"] and f["place"] == "tool"]
    ours = np.array([np.sqrt(np.sum(f["error"][f["seen"]] ** 2)) for f in ticks])
    naive = np.array([f["naive"] for f in ticks])
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharey=True)
    for axis, (title, (name, edges)) in zip(axes, EDGES.items(), strict=True):
        bins = np.digitize([f[name] for f in ticks], edges) - 1
        for error, colour, label in ((ours, "C0", "contactd"), (naive, "C3", "pseudo-inverse")):
            parts = [error[bins == k] for k in range(len(edges) - 1)]
            parts = [part if len(part) else np.array([np.nan]) for part in parts]
            for share, style in ((50, "o-"), (95, "^--")):
                at = [np.percentile(part, share) for part in parts]
                axis.plot(at, style, color=colour, label=f"{label}, {share} %")
        names = [f"{a:g} to {b:g}" for a, b in pairwise(edges[:-1])]
        axis.set_xticks(range(len(edges) - 1), [*names, f"over {edges[-2]:g}"], fontsize=7)
        axis.set(xlabel=title, yscale="log")
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("error of the force [N]")
    axes[0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
