"""Fig. 13: sinusoid, push, guide, release, resume."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.paper.experiments import Conditions, collaboration
from bench.paper.figure import STYLE, Made, canvas, finish, runs
from bench.report import Target
from bench.study.recording import Recording
from daemon.modes.table import Mode
from programs.demo.demo_story import RunFigures

MODE_COLOURS = {Mode.TRACKING: "#e4eef7", Mode.ADMITTANCE: "#fde3c8"}
TIMING = ("ticks", "missed", "lateness_us", "tick_us")  # of the machine, not of the experiment


def make(seed: int) -> Made:
    """Figure 13 with stiction, as the paper's arm has it."""
    recording, story = collaboration(Conditions(seed, "dahl"))
    table = numbers(recording, story)
    return Made(table, held_against(table), {"figure_13": picture(recording)})


def numbers(recording: Recording, story: RunFigures) -> dict[str, Any]:
    """Times of the story, and how far the arm was led and drifted."""
    report = story.report(ended_well=True)
    led = recording.mode == Mode.ADMITTANCE
    touched = np.any(recording.true_torque, axis=1)
    table = {key: value for key, value in report.items() if key not in TIMING}
    table["resume_jump"] = round(story.resume_jump, 4)
    table["checks"] = {check.what: bool(check.happened) for check in story.checks()}
    table["hand_s"] = [round(float(t), 3) for t in recording.time_s[touched][[0, -1]]]
    if led.any():
        way = recording.true_q[led][-1] - recording.true_q[led][0]
        released = recording.true_q[led & ~touched]
        table["led_rad"] = [round(float(x), 3) for x in way]
        drift = np.abs(released - released[0]).max(axis=0)
        table["drift_after_release_rad"] = [round(float(x), 4) for x in drift]
    return table


def held_against(table: dict[str, Any]) -> list[Target]:
    """The story happened, and went on after two quiet seconds, without a jump."""
    unhappy = sum(not happened for happened in table["checks"].values())
    false = table["false_contacts"]["backlash"]
    return [
        Target("Fig. 13: things that did not happen", unhappy, 0),
        Target("Fig. 13: false contacts", false, 0),
        Target("Fig. 13: quiet time before it went on", table["quiet_s"], 2.03, "s"),
        Target(
            "Fig. 13: jump of the setpoint there, over what acceleration allows",
            table["resume_jump"],
            1.0,
            "x",
        ),
    ]


def picture(recording: Recording) -> Figure:
    """Positions above, thresholded residuals below, as in the paper; modes as bands."""
    figure = canvas(9.0, 6.2, "Fig. 13: a person takes the arm out of its motion and lets go")
    above, below = figure.subplots(2, 1, sharex=True)
    for axes in (above, below):
        for mode, begin, end in runs(recording.mode, recording.time_s):
            axes.axvspan(begin, end, color=MODE_COLOURS[Mode(mode)], lw=0)
    for mode, begin, end in runs(recording.mode, recording.time_s):
        _write_above(above, begin, end, str(mode))
    thresholded = recording.thresholded("backlash")
    for i, name in enumerate(recording.joints):
        label = f"{i + 1} {name}"
        above.plot(recording.time_s, recording.true_q[:, i], label=label, **STYLE)
        below.plot(recording.time_s, thresholded[:, i], **STYLE)
    touched = np.any(recording.true_torque, axis=1)
    for axes in (above, below):
        for on, begin, end in runs(touched, recording.time_s):
            if on:
                axes.axvline(begin, color="0.3", lw=0.8, ls=":")
                axes.axvline(end, color="0.3", lw=0.8, ls=":")
                if axes is below:
                    _write_above(axes, begin, end, "hand on the arm")
    finish(above, "link position [rad]", last=False)
    finish(below, "residual beyond its threshold [Nm]")
    figure.legend(loc="outside right center", fontsize=8)
    return figure


def _write_above(axes: Axes, begin: float, end: float, words: str) -> None:
    axes.annotate(
        words,
        (0.5 * (begin + end), 1.0),
        (0, 3),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        ha="center",
        fontsize=8,
    )
