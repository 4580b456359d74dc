"""`contactd new`: a folder for an arm, from its URDF and the EDS of its drives."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import click

from daemon.commands.simulated_robot import write_truth
from daemon.config.draft import MARK, draft
from daemon.config.drafted_drive import drafted_drive
from daemon.config.load import load_robot
from drivers.boot.data_sheet import load_data_sheet
from errors import ConfigurationError
from regular_file import read_text


def new_arm(folder: Path, urdf: Path, sheets: Sequence[str]) -> None:
    """Write config.yaml, simulation.yaml and copies of URDF and EDS into a new folder, and say what
    is left to do. Raises ConfigurationError; nothing is overwritten, and nothing half-written is
    left."""
    try:
        text = read_text(urdf)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{urdf} cannot be read: {error}") from error
    named = dict(_named(sheet) for sheet in sheets)
    if len(named) < len(sheets):
        raise ConfigurationError("--eds: two drives of one name; give them as NAME=FILE")
    drives = {
        name: (path.name, drafted_drive(load_data_sheet(path), str(path)))
        for name, path in named.items()
    }
    written = draft(folder.resolve().name, text, urdf.name, drives)
    if folder.exists():
        raise ConfigurationError(f"{folder} exists: it is never overwritten")
    folder.mkdir(parents=True)
    try:
        (folder / "config.yaml").write_text(written, encoding="utf-8")
        for path in (urdf, *named.values()):
            shutil.copyfile(path, folder / path.name)
        write_truth(load_robot(folder))
    except BaseException:
        shutil.rmtree(folder)
        raise
    _say(folder, written, [f"{n}: {r}" for n, (_, d) in drives.items() for r in d.remarks])


def _named(sheet: str) -> tuple[str, Path]:
    """NAME=FILE, or a file whose own name is that of the profile."""
    name, equals, file = sheet.rpartition("=")
    path = Path(file)
    return (name if equals else path.stem.lower().replace("-", "_").replace(" ", "_"), path)


def _say(folder: Path, written: str, remarks: Sequence[str]) -> None:
    marked = written.count(MARK)
    click.echo(f"wrote {folder / 'config.yaml'}: {marked} lines with CHECK hold guesses")
    for remark in remarks:
        click.echo(remark)
    click.echo(
        f"""next:
  contactd check {folder}
    says what is wrong, and what follows from it
  contactd check --explain FIELD
    what a field is and how to find it
  contactd scan {folder}
    who is on the bus
  contactd simulate {folder}
    rehearse, with the arm of simulation.yaml there"""
    )
