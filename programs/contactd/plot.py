"""`contactd plot`: plots a recording to HTML, PNG or SVG, and prints values at a time."""

from collections.abc import Sequence
from pathlib import Path

import click

from common.new_file import refuse_suffix, whole_file
from programs.command_line.progress import reading
from programs.recordings.html import page_of
from programs.recordings.reading import read_contents
from programs.recordings.view import View, read_view, said_at

SUFFIXES = (".html", ".png", ".svg")


def plot_recording(
    file: Path, joints: Sequence[str], around: str, window_s: float, output: Path | None
) -> bool:
    """Plot `file` to `output`, by default an HTML page in the working directory, and print its
    path; True if the recording was complete. Raises LogError."""
    target = output or Path(f"{file.stem}.html")  # with_suffix would cut a stem that has dots
    refuse_suffix(target, SUFFIXES)
    with reading(file) as progress:
        view = read_view(file, joints, around, window_s, progress)
    for line in said_at(view):
        click.echo(line)
    _write(view, target, every_joint=bool(joints))
    click.echo(f"plotted: {target}")
    if view.broken:
        click.echo(f"contactd: {view.broken}", err=True)
    return not view.broken


def _write(view: View, target: Path, *, every_joint: bool) -> None:
    if target.suffix.lower() == ".html":
        page = page_of(view)
        with whole_file(target) as partial:
            partial.write_text(page, encoding="utf-8")
        return
    from programs.recordings.picture import draw  # noqa: PLC0415 - loads matplotlib

    draw(view, target, every_joint=every_joint)


def newest_fault(around: str) -> tuple[Path, str]:
    """Recording of the newest black-box log with a fault, else of the newest log, and what to plot
    around: its fault, unless `around` is given or there is none. Raises LogError."""
    from programs.recordings.recomputed import as_recording, last_fault  # noqa: PLC0415 - slow

    log = last_fault()
    file = as_recording(log)
    click.echo(f"{log}: the estimator starts afresh on its frames, with higher thresholds")
    if not around and read_contents(file)[0].faults:
        around = "fault"
    return file, around
