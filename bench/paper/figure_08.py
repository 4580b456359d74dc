"""Fig. 8: the first joint in motion without contact, classical residual against backlash."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.paper.experiments import Conditions, contact_free
from bench.paper.figure import (
    COLOURS,
    LINK,
    STYLE,
    THRESHOLD,
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

SHOWN_S = (5.0, 30.0)


def make(seed: int) -> Made:
    """Figure 8 with smooth friction and with stiction; the picture shows stiction."""
    table, targets = {}, []
    for friction in ("smooth", "dahl"):
        recording = contact_free(Conditions(seed, friction))
        table[friction] = numbers(recording)
        targets += held_against(table[friction], friction)
    return Made(table, targets, {"figure_08": first_joint(recording.part(*SHOWN_S))})


def numbers(recording: Recording) -> dict[str, Any]:
    """Crossings of the first joint, and what every residual makes of the motion."""
    return {
        "seconds": round(float(recording.time_s[-1]), 2),
        "crossings": len(crossings(recording, 0)),
        "residuals": residual_table(recording, contact_levels(recording)),
    }


def held_against(table: dict[str, Any], friction: str) -> list[Target]:
    """No false contact on any joint; and how much smaller a threshold would do on the first."""
    backlash, classical = table["residuals"]["backlash"], table["residuals"]["classical"]
    ratio = classical["largest_in_motion_nm"][0] / backlash["largest_in_motion_nm"][0]
    name = f"Fig. 8, {friction} friction"
    return [
        Target(f"{name}: false contacts, backlash", sum(backlash["false"]), 0),
        Target(f"{name}: joint 1, classical over backlash", round(ratio, 2), 4, "x", "higher"),
    ]


def first_joint(recording: Recording) -> Figure:
    """The paper's figure, and the rivals below."""
    title = "Fig. 8: joint 1 in motion without contact (with stiction)"
    figure = canvas(8.0, 7.2, title)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.3, 1.3))
    for axes in (top, middle, bottom):
        draw_crossings(axes, recording, 0)
    draw_phi(top, recording, 0)
    for axes in (middle, bottom):
        draw_thresholds(axes, recording, 0)
        axes.set_ylim(-1.55, 2.15)
    draw_residual(middle, recording, "classical", 0, label="classical, eq. (2)")
    draw_residual(middle, recording, "backlash", 0, label="backlash, eq. (13)")
    draw_residual(bottom, recording, "classical+friction", 0, label="classical, friction known")
    draw_residual(bottom, recording, "kalman", 0, label="Kalman observer, friction and rotor known")
    draw_residual(bottom, recording, "backlash", 0, label="backlash")
    finish(top, "φ = q - θ [rad]", last=False)
    finish(middle, "residual r [Nm]", last=False)
    finish(bottom, "residual r [Nm]")
    top.legend(loc="upper right", fontsize=8, ncols=4)
    middle.legend(loc="upper right", fontsize=8, ncols=4)
    bottom.legend(loc="upper right", fontsize=8, ncols=3)
    top.set_ylim(-0.026, 0.036)
    return figure


def draw_phi(axes: Axes, recording: Recording, joint: int) -> None:
    """phi in truth and as estimated, between the borders of the gap."""
    alpha = recording.configuration.joints[joint].half_gap
    phi = recording.true_q[:, joint] - recording.true_theta[:, joint]
    estimated = recording.phi[:, joint]
    axes.plot(recording.time_s, phi, color=LINK, label="true", **STYLE)
    axes.plot(recording.time_s, estimated, color=COLOURS["backlash"], label="estimated", **STYLE)
    for border, label in ((alpha, "half-gap ±α"), (-alpha, "_")):
        axes.axhline(border, label=label, **THRESHOLD)
    reach = 1.4 * max(alpha, 0.003)
    axes.set_ylim(-reach, reach)
