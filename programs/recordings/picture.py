"""Plot of a recording by matplotlib (extra `plot`): PNG or SVG, a column of panels per joint."""

from pathlib import Path
from typing import Any, Final

from common.new_file import whole_file
from daemon.protocol.text import printable
from programs.recordings.html import about, events_in, first_shown
from programs.recordings.pictures import without_matplotlib
from programs.recordings.view import View

# Colours of the page, which colour-blind people can distinguish, too.
BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a8f94"
MODE_COLOURS: Final = {
    "off": GREY,
    "enabling": "#f0e442",
    "holding": BLUE,
    "tracking": GREEN,
    "admittance": "#56b4e9",
    "retracting": PINK,
    "returning": "#e69f00",
    "releasing": ORANGE,
    "stopping": "#f0e442",
    "faulted": "#c00000",
}
_HEIGHTS: Final = (2.2, 1.2, 1.2, 1.4)


def draw(view: View, path: Path, *, every_joint: bool) -> None:
    """Write the plot; if there are many joints, only those with contacts unless `every_joint`.
    Raises LogError without matplotlib."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise without_matplotlib(path, "write an .html, which needs none, or ") from error
    joints = view.joints if every_joint else first_shown(view)
    style = {"font.size": 8, "axes.spines.top": False, "axes.spines.right": False,
             "svg.hashsalt": "contactd"}  # fmt: skip
    with mpl.rc_context(style):
        size = (max(7.0, 5.2 * len(joints)), sum(_HEIGHTS) + 0.8)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(
            len(_HEIGHTS), len(joints), sharex=True, squeeze=False, height_ratios=_HEIGHTS
        )
        for column, joint in zip(panels.T, joints, strict=True):
            _joint(view, joint, column)
        figure.suptitle(f"{printable(view.name)}: {about(view)}", fontsize=8)
        with whole_file(path) as partial:
            figure.savefig(partial, dpi=130)


def _joint(view: View, joint: int, column: Any) -> None:
    """Draw the four panels of a joint."""
    signals = view.signals
    rows = {name: values[:, joint] for name, values in signals.values.items()}
    residual, velocity, current, gap = column
    time_s, name = signals.time_s, view.contents.joints[joint]
    residual.set_title(name, loc="left", fontweight="bold")
    residual.plot(time_s, rows["residual"], color=BLUE, lw=1.0, label="residual")
    for sign in (1, -1):
        label = "threshold in force" if sign > 0 else None
        residual.plot(time_s, sign * rows["threshold"], color=ORANGE, lw=0.8, ls="--", label=label)
    residual.set_ylabel("residual [Nm]")
    velocity.plot(time_s, rows["link_velocity"], color=BLUE, lw=0.8, label="link")
    velocity.plot(time_s, rows["motor_velocity"], color=ORANGE, lw=0.6, label="motor")
    velocity.set_ylabel("velocity\n[rad/s]")
    current.plot(time_s, rows["current"], color=GREEN, lw=0.8, label="current")
    current.set_ylabel("current [A]")
    phi, sigma = 1e3 * rows["phi"], 1e3 * rows["phi_sigma"]
    gap.fill_between(time_s, phi - sigma, phi + sigma, color=GREY, alpha=0.35, lw=0)
    gap.plot(time_s, phi, color=PINK, lw=1.0, label="phi and its uncertainty")
    half_gap = 1e3 * view.half_gap[joint]
    for edge in (-half_gap, half_gap) if half_gap > 0.0 else ():
        gap.axhline(edge, color=ORANGE, lw=0.8, ls="--", label="half-gap" if edge > 0 else None)
    gap.set(ylabel="phi [mrad]", xlabel="time [s]")
    for panel in column:
        _marks(view, name, panel)
        panel.set_xlim(view.from_s, max(view.until_s, view.from_s + 1e-3))
    for panel in column:
        panel.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, fontsize=6, frameon=False,
            borderpad=0.1, handlelength=1.4, columnspacing=1.0,
        )  # fmt: skip
    _mode_names(view, residual)


def _marks(view: View, joint: str, panel: Any) -> None:
    """Draw modes as shading; contacts, faults and the time in question as lines."""
    for span in view.signals.modes:
        colour = MODE_COLOURS.get(span.mode, GREY)
        panel.axvspan(span.begin_s, span.end_s, color=colour, alpha=0.12, lw=0)
    named = set[str]()

    def named_once(name: str) -> str | None:
        """Label for the first line of a kind, in the top panel; None for further ones."""
        if name in named or not panel.get_subplotspec().is_first_row():
            return None
        named.add(name)
        return name

    for contact in view.contents.contacts:
        if view.from_s <= contact.time_s <= view.until_s:
            own = contact.joint == joint
            panel.axvline(contact.time_s, color=ORANGE, lw=1.0 if own else 0.5,
                          ls="-" if own else ":",
                          label=named_once("contact" if own else "elsewhere"))  # fmt: skip
    for event in events_in(view):
        if event.kind != "contact":
            fault = event.kind == "fault"
            panel.axvline(event.time_s, color="#c00000" if fault else GREY,
                          lw=1.6 if fault else 0.4, ls="-" if fault else ":",
                          label=named_once("fault") if fault else None)  # fmt: skip
    if view.at_s is not None:
        panel.axvline(view.at_s, color="black", lw=0.8, ls="--")


def _mode_names(view: View, panel: Any) -> None:
    """Write the names of modes that last long enough for the text to fit."""
    least_s = 0.12 * (view.until_s - view.from_s)
    low = panel.get_ylim()[0]
    for span in view.signals.modes:
        begin, end = max(span.begin_s, view.from_s), min(span.end_s, view.until_s)
        if end - begin > least_s:
            panel.text(0.5 * (begin + end), low, span.mode, ha="center", va="bottom", fontsize=6)
