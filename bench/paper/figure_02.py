"""Fig. 2: the classical residual on one joint with a gap of 0.1 rad."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.paper.experiments import Conditions, single_joint
from bench.paper.figure import (
    LINK,
    MOTOR,
    STYLE,
    Made,
    canvas,
    contact_levels,
    crossings,
    draw_crossings,
    draw_residual,
    draw_thresholds,
    finish,
    residual_table,
)
from bench.report import Target
from bench.study.recording import Recording

SHOWN_S = (2.5, 15.5)
EXACT_S = 10.0  # of a plant that the model knows perfectly: what is left is of the sampling
AFTER_S = 0.3  # a crossing's error lasts until the residual has forgotten the impact


def make(seed: int) -> Made:
    """Run it, count it, draw it."""
    recording = single_joint(Conditions(seed))
    table = numbers(recording)
    table["exact_model"] = numbers(single_joint(Conditions(seed, exact=True), EXACT_S))
    backlash = table["residuals"]["backlash"]
    gap = table["while_crossing_nm"]
    targets = [
        Target("Fig. 2: false contacts, backlash", backlash["false"][0], 0),
        Target(
            "Fig. 2: error while crossing, classical over backlash",
            round(gap["classical"] / gap["backlash"], 2),
            4,
            "x",
            "higher",
        ),
    ]
    return Made(table, targets, {"figure_02": picture(recording.part(*SHOWN_S))})


def numbers(recording: Recording) -> dict[str, Any]:
    """Largest |r| while the gap is crossed and elsewhere, from the second crossing on. The first
    one is from the middle of the gap, where the rotor's place is still unknown."""
    crossing = _lasting(recording.true_in_gap[:, 0], AFTER_S, recording)
    all_crossings = crossings(recording, 0)
    known = recording.time_s > all_crossings[0][1] + AFTER_S
    apart = recording.true_in_gap[:, 0] & known
    return {
        "seconds": round(float(recording.time_s[-1]), 2),
        "crossings": len(all_crossings),
        "gap_share": round(float(recording.true_in_gap[:, 0].mean()), 3),
        "gap_recognised_share": round(float(np.mean(recording.side[apart, 0] == 0)), 3),
        "while_crossing_nm": _largest(recording, crossing & known),
        "elsewhere_nm": _largest(recording, ~crossing & known),
        "residuals": residual_table(recording, contact_levels(recording)),
    }


def picture(recording: Recording) -> Figure:
    """Positions above, residuals below, as in the paper; the crossings shaded."""
    figure = canvas(8.0, 5.6, "Fig. 2: a joint with a gap of 0.1 rad in motion, no person near")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.2))
    for axes in (above, below):
        draw_crossings(axes, recording, 0)
    above.plot(recording.time_s, recording.true_q[:, 0], color=LINK, label="link q", **STYLE)
    above.plot(recording.time_s, recording.true_theta[:, 0], color=MOTOR, label="motor θ", **STYLE)
    draw_thresholds(below, recording, 0)
    draw_residual(below, recording, "classical", 0, label="classical residual, eq. (2)")
    draw_residual(below, recording, "classical+friction", 0, label="classical, friction known")
    draw_residual(below, recording, "backlash", 0, label="backlash residual, eq. (13)")
    finish(above, "position [rad]", last=False)
    finish(below, "residual r [Nm]")
    above.set_ylim(-0.85, 1.15)
    below.set_ylim(-1.2, 1.9)
    above.legend(loc="upper right", fontsize=8, ncols=3)
    below.legend(loc="upper right", fontsize=8, ncols=3)
    return figure


def _largest(recording: Recording, ticks: NDArray[np.bool_]) -> dict[str, float]:
    return {
        name: round(float(np.abs(values[ticks, 0]).max()), 3)
        for name, values in recording.residuals.items()
    }


def _lasting(on: NDArray[np.bool_], seconds: float, recording: Recording) -> NDArray[np.bool_]:
    """`on`, each tick of it lasting so much longer."""
    ticks = round(seconds / recording.configuration.period_s)
    lasting: NDArray[np.bool_] = np.convolve(on, np.ones(ticks + 1))[: len(on)] > 0
    return lasting
