"""Styles and words shared by the dashboard and the status report."""

from rich.text import Text

from daemon.modes.table import Mode
from daemon.protocol.replies import Status
from daemon.protocol.state import State

MODE_STYLES = {
    Mode.OFF: "white on grey30",
    Mode.ENABLING: "black on yellow",
    Mode.HOLDING: "white on blue",
    Mode.TRACKING: "white on dark_green",
    Mode.ADMITTANCE: "black on bright_cyan",
    Mode.RETRACTING: "black on bright_magenta",
    Mode.RETURNING: "white on dark_cyan",
    Mode.RELEASING: "black on magenta",
    Mode.STOPPING: "black on yellow",
    Mode.FAULTED: "white on red",
}
SIDE_STYLES = {"gap": "cyan", "left": "", "right": "", "unknown": "yellow"}


def not_seen_to_stand(shown: State | Status, indent: str = "") -> Text:
    """Words on joints of a faulted arm that are not confirmed at standstill; empty if none."""
    lines = []
    if shown.mode == Mode.FAULTED and shown.unproved:
        lines.append(f"{indent}not seen to stand: {', '.join(shown.unproved)}")
    if shown.mode == Mode.FAULTED and shown.silenced:
        lines.append(f"{indent}silent until reset: contactd sends nothing to the drives")
    return Text("\n".join(lines), "bold red")


def residual_style(residual: float, threshold: float) -> str:
    """Style of a residual: green, yellow from half the threshold on, red beyond it."""
    if abs(residual) > threshold:
        return "bold red"
    return "yellow" if abs(residual) > 0.5 * threshold else "green"


OPERATING = ("operation enabled", "enabled", "running")
"""States of energised drives, as named by each make."""


def drive_text(name: str) -> Text:
    """Drive state, green in operation, red in fault, else yellow."""
    styles = dict.fromkeys(OPERATING, "green") | {"fault": "bold red"}
    return Text(name, styles.get(name, "yellow"))


def clock(seconds: float) -> str:
    """Duration as h:mm:ss.s."""
    minutes, rest = divmod(seconds, 60.0)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02d}:{rest:04.1f}"
