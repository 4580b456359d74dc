"""`contactd export`: converts a recording to another format."""

from collections.abc import Sequence
from pathlib import Path

import click

from common.new_file import refuse_unless_new
from programs.command_line.progress import reading
from programs.contactd.whatif import write_template
from programs.recordings.export import export_csv, export_foxglove
from programs.recordings.lerobot import export_lerobot

NAMES = {"foxglove": "-foxglove.mcap", "csv": ".csv", "labels": "-labels.csv"}


def export_dataset(files: Sequence[Path], target: Path, fps: int, task: str) -> bool:
    """Write recordings as a LeRobot dataset; True if all were complete. Raises LogError."""
    refuse_unless_new(target)
    with reading(files[0]) as progress:
        broken = export_lerobot(files, target, fps, task, progress)
    click.echo(f"exported: {target}")
    if broken:
        click.echo(f"contactd: {broken}", err=True)
    return not broken


def export_recording(file: Path, form: str, output: Path | None) -> bool:
    """Convert `file` into a new file; True if it was complete. Raises LogError."""
    target = output or Path(f"{file.stem}{NAMES[form]}")
    if form == "labels":
        return write_template([file], target)
    refuse_unless_new(target)
    write = {"foxglove": export_foxglove, "csv": export_csv}[form]
    with reading(file) as progress:
        broken = write(file, target, progress)
    click.echo(f"exported: {target}")
    if broken:
        click.echo(f"contactd: {broken}", err=True)
    return not broken
