"""Figs. 9 and 11: contacts at rest for 20 s, then in motion, on joints 1, 3, 4 and 7."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bench.paper.experiments import FOUR_JOINTS, REST_S, Conditions, contacts
from bench.paper.figure import (
    COLOURS,
    STYLE,
    Made,
    canvas,
    contact_levels,
    draw_thresholds,
    finish,
    residual_table,
)
from bench.report import Target
from bench.study.recording import Recording


def make(seed: int) -> Made:
    """Figures 9 and 11 with smooth friction and with stiction; the pictures show stiction."""
    table, targets = {}, []
    for friction in ("smooth", "dahl"):
        recording = contacts(Conditions(seed, friction))
        table[friction] = numbers(recording)
        targets += held_against(table[friction], friction, recording.configuration.estimator.gain)
    pictures = {"figure_09": trajectory(recording), "figure_11": detected(recording)}
    return Made(table, targets, pictures)


def numbers(recording: Recording) -> dict[str, Any]:
    """Contacts that every residual detected, missed or invented; at rest and in motion."""
    levels = contact_levels(recording)
    at_rest = recording.part(0.0, REST_S)
    moving = recording.part(REST_S, np.inf)
    return {
        "seconds": round(float(recording.time_s[-1]), 2),
        "largest_true_nm": [round(float(x), 3) for x in np.abs(recording.true_torque).max(axis=0)],
        "at rest": residual_table(at_rest, levels),
        "in motion": residual_table(moving, levels),
    }


def held_against(table: dict[str, Any], friction: str, gain: float) -> list[Target]:
    """All detected, none false; in motion no later than a rising torque takes through the filter.

    A first-order filter follows a ramp 1 / K late; 15 ms more for sampling and transport.
    """
    targets = []
    for part in ("at rest", "in motion"):
        backlash = table[part]["backlash"]
        name = f"Fig. 11, {friction} friction, {part}"
        targets += [
            Target(f"{name}: contacts missed", sum(backlash["missed"]), 0),
            Target(f"{name}: false contacts", sum(backlash["false"]), 0),
        ]
    delay = median_delay_ms(table["in motion"]["backlash"])
    limit = round(1000.0 / gain + 15.0, 1)
    targets.append(Target(f"{name}: median delay", delay, limit, "ms"))
    return targets


def median_delay_ms(row: dict[str, Any]) -> float:
    """Over all joints, from where the true torque reached the threshold."""
    delays = [delay for joint in row["delays_ms"] for delay in joint]
    return round(float(np.median(delays)), 1) if delays else float("inf")


def trajectory(recording: Recording) -> Figure:
    """Fig. 9: desired positions."""
    figure = canvas(8.0, 3.6, "Fig. 9: desired trajectory of the second experiment")
    axes = figure.subplots()
    for i, name in enumerate(recording.joints):
        label = f"{i + 1} {name}"
        axes.plot(recording.time_s, recording.reference[:, i], label=label, **STYLE)
    finish(axes, "desired position [rad]")
    figure.legend(loc="outside right center", fontsize=8)
    return figure


def detected(recording: Recording) -> Figure:
    """Fig. 11: thresholded residuals over the true torque, joint by joint."""
    title = "Fig. 11: contacts at rest (20 s) and in motion, thresholded residuals (with stiction)"
    figure = canvas(10.0, 8.0, title)
    shown = [i for i, name in enumerate(recording.joints) if name in FOUR_JOINTS]
    rows = figure.subplots(len(shown) + 1, 1, sharex=True, height_ratios=[1.0] * len(shown) + [0.6])
    thresholded = recording.thresholded("backlash")
    for axes, i in zip(rows, shown, strict=False):
        true = recording.true_torque[:, i]
        axes.fill_between(recording.time_s, true, color="0.7", lw=0, label="true external torque")
        draw_thresholds(axes, recording, i)
        colour = COLOURS["backlash"]
        label = "thresholded backlash residual"
        axes.plot(recording.time_s, thresholded[:, i], color=colour, label=label, **STYLE)
        finish(axes, f"joint {i + 1} [Nm]", last=False)
    others = [i for i in range(len(recording.joints)) if i not in shown]
    for i in others:
        rows[-1].plot(recording.time_s, thresholded[:, i], label=f"joint {i + 1}", **STYLE)
    rows[-1].set_ylim(-0.5, 0.5)
    rows[-1].legend(loc="upper right", fontsize=8, ncols=len(others))
    finish(rows[-1], "others [Nm]")
    for axes in rows:
        axes.axvline(REST_S, color="0.4", lw=0.8)
    for x, words, side in ((-4, "at rest", "right"), (4, "in motion", "left")):
        rows[0].annotate(
            words,
            (REST_S, 1.0),
            (x, -10),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            fontsize=8,
            ha=side,
        )
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", fontsize=8, ncols=3)
    return figure
