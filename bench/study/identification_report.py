"""Report of `bench.identification` for people: lines and a picture."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from arrays import Vector

OUT: Final = Path(__file__).parents[1] / "out"
TITLES: Final = {
    "K_theta_s": "Coulomb friction of motor and link, $K_{\\theta s}$",
    "K_theta_v": "viscous friction of motor and link, $K_{\\theta v}$",
    "B": "inertia of the rotor, $B$",
    "K_q_s": "Coulomb friction of the link alone, $K_{qs}$, where the gap showed it",
    "K_q_v": "viscous friction of the link alone, $K_{qv}$, where the gap showed it",
}
LIMITS: Final = {"K_theta_s": 10.0, "K_theta_v": 15.0, "B": 10.0}
"""of the error [%], 95 % of the arms"""
COLOURS: Final = ("tab:blue", "tab:orange", "tab:green", "tab:red")
BOXES: Final[dict[str, Any]] = {
    "whis": (5.0, 95.0),
    "showfliers": False,
    "patch_artist": True,
    "medianprops": {"color": "black"},
}


def allowed_of_gap(true_half_gap: Vector) -> Vector:
    """5 %, or 0.5 mrad where that is more [rad]."""
    return np.asarray(np.maximum(0.05 * true_half_gap, 0.0005))


def summary(errors: Vector) -> dict[str, list[float | None]]:
    """Summary of errors (arms, n), per joint: median and 95th percentile of their sizes, None where
    no arm has an answer, and the share of arms without one."""
    size = [np.abs(column[~np.isnan(column)]) for column in errors.T]
    return {
        "median": [round(float(np.median(x)), 3) if len(x) else None for x in size],
        "p95": [round(float(np.percentile(x, 95.0)), 3) if len(x) else None for x in size],
        "unanswered": np.isnan(errors).mean(axis=0).round(3).tolist(),
    }


def lines(data: dict[str, Any]) -> Iterator[str]:
    """A block for each case, a line for each coefficient."""

    def row(name: str, one: dict[str, list[float | None]]) -> str:
        pairs = zip(one["median"], one["p95"], strict=True)
        cells = (f"{m:.2f}/{p:.2f}" if m is not None else "-" for m, p in pairs)
        return f"  {name:14}" + "".join(f"{cell:>13}" for cell in cells)

    heads = "".join(f"{i:>13}" for i in range(1, len(data["joints"]) + 1))
    for case, by_coefficient in data["errors_percent"].items():
        yield f"\n{case}: size of the errors over {data['arms']} arms, median/95 %"
        yield f"  {'joint':14}{heads}"
        yield from (row(f"{name} [%]", one) for name, one in by_coefficient.items())
    yield "\na hand at each link"
    yield row("alpha [mrad]", data["half_gap_mrad"])
    yield f"\npicture: {data['picture']}\n"


def picture(
    errors: dict[str, Vector],
    coefficients: Sequence[str],
    half_gap: Vector,
    true_half_gap: Vector,
    joints: list[str],
) -> Path:
    """Boxes of the errors per joint: one panel for each coefficient, one colour for each case."""
    figure = Figure(figsize=(15, 12), layout="constrained")
    panels = figure.subplots(3, 2, sharex=True).ravel()
    for axes, (k, name) in zip(panels[[0, 1, 2, 4, 5]], enumerate(coefficients), strict=True):
        _boxes(axes, [100.0 * e[:, k] for e in errors.values()])
        axes.set(title=TITLES[name], ylabel="error [%]")
        if name in LIMITS:
            _allowed(axes, np.full(len(joints), LIMITS[name]))
    _boxes(panels[3], [1e3 * (half_gap - true_half_gap)])
    # 5 % of a small gap is less than of a large one: the strictest of all arms.
    _allowed(panels[3], 1e3 * allowed_of_gap(true_half_gap).min(axis=0))
    panels[3].set(title="half-gap, $\\alpha$, by a hand (usual noise)", ylabel="error [mrad]")
    for axes in panels[4:]:
        axes.set_xticks(range(len(joints)), joints, rotation=20)
    handles = [Patch(facecolor=c, label=n) for n, c in zip(errors, COLOURS, strict=True)]
    handles.append(Patch(facecolor="0.9", label="allowed to 95 % of the arms"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    arms = len(half_gap)
    figure.suptitle(f"What is found of {arms} arms that nobody knows: boxes have the middle half "
                    "of the arms, whiskers 5 to 95 %")  # fmt: skip
    OUT.mkdir(exist_ok=True)
    path = OUT / "identification.png"
    figure.savefig(path, dpi=100)
    return path


def _boxes(axes: Axes, by_case: list[Vector]) -> None:
    """by_case: (arms, n) each."""
    width = 0.8 / len(by_case)
    for k, errors in enumerate(by_case):
        columns = [column[~np.isnan(column)] for column in errors.T]
        at = np.arange(len(columns)) - 0.4 + (k + 0.5) * width
        drawn = axes.boxplot(columns, positions=at, widths=0.8 * width, manage_ticks=False, **BOXES)
        for box in drawn["boxes"]:
            box.set_facecolor(COLOURS[k])
    axes.axhline(0.0, color="0.3", linewidth=0.6)
    axes.set_xlim(-0.5, len(by_case[0].T) - 0.5)
    axes.grid(axis="y", color="0.92", linewidth=0.6)
    axes.set_axisbelow(True)


def _allowed(axes: Axes, limit: Vector) -> None:
    """A grey ground of +- limit (n,) for each joint."""
    at = np.arange(len(limit))
    axes.bar(at, 2.0 * limit, 1.0, bottom=-limit, color="0.93", zorder=0)
