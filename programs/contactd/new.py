"""`contactd new`: creates the folder of an arm from its URDF and its drives' EDS or models."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import click

from common.errors import ConfigurationError
from common.regular_file import read_text
from daemon.config.load import load_robot
from daemon.config.mistakes import urdf_mistakes
from drivers.canopen.boot.data_sheet import load_data_sheet
from programs.command_line.sentences import say
from programs.contactd.drafts.choice import RULES
from programs.contactd.drafts.configuration import Draft, draft, guesses, planned
from programs.contactd.drafts.drive import drafted_drive
from programs.contactd.drafts.motors import model_of
from programs.simulate import simulated_robot
from programs.simulate.simulated_robot import write_truth

WRITTEN = ("config.yaml", "identified.yaml", simulated_robot.FILE, simulated_robot.URDF)


def new_arm(
    folder: Path, urdf: Path, sheets: Sequence[str], objects: Sequence[str] = (),
    models: Sequence[str] = (),
) -> None:  # fmt: skip
    """Write config.yaml, simulation.yaml and copies of URDF and EDS into a new folder, and print
    the next commands. sheets: [NAME=]FILE, or instead models: [NAME=]MAKE:MODEL; objects:
    [NAME.]QUANTITY=INDEX[:SUB]. Nothing is overwritten, and no partial folder is left behind.
    Raises ConfigurationError."""
    try:
        text = read_text(urdf)
    except OSError as error:
        raise ConfigurationError(f"{urdf} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{urdf} cannot be read: {error}") from error
    if bool(sheets) is bool(models):
        raise ConfigurationError(
            "either --eds, for CANopen drives, or --drive, for motors without an EDS, is needed: "
            "all drives of an arm must be of one make"
        )
    if models and objects:
        raise ConfigurationError("--object: only drives with an EDS have objects")
    given = [_named(sheet) for sheet in sheets]
    named = dict(given)
    if len(named) < len(set(given)):
        raise ConfigurationError("--eds: two drives have the same name; give them as NAME=FILE")
    _refuse_clashes((urdf, *named.values()))
    order: Sequence[str] = [name for name, _ in given]
    drives, order = _motors(models) if models else (_of_sheets(named, objects), order)
    plan = planned(text, urdf.name, drives, order)
    written = draft(folder.resolve().name, urdf.name, plan)
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise ConfigurationError(f"{folder} exists: it is never overwritten") from error
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be created: {error.strerror}") from error
    try:
        (folder / "config.yaml").write_text(written, encoding="utf-8")
        for path in (urdf, *named.values()):
            shutil.copyfile(path, folder / path.name)
        at_motor = {name for name in named if not drives[name].link_encoder}
        write_truth(load_robot(folder), at_motor)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):
            why = f"{folder} cannot be written: {error.strerror}"
            raise ConfigurationError(why) from error
        if isinstance(error, ConfigurationError):
            why = f"{folder} is not written: the draft made from {urdf} and the drives is refused"
            raise ConfigurationError(f"{why}:\n{error}") from error
        raise
    of_urdf = [f"{urdf.name}, {place}: {what}" for place, what in urdf_mistakes(text)]
    _report(folder, written, [*of_urdf, *plan.verdicts()], guarded=bool(models))


def _of_sheets(named: dict[str, Path], objects: Sequence[str]) -> dict[str, Draft]:
    """Drafts of CANopen drives by name."""
    by_hand = _by_hand(objects, tuple(named))
    return {
        name: drafted_drive(load_data_sheet(path), str(path), by_hand[name])
        for name, path in named.items()
    }


def _motors(models: Sequence[str]) -> tuple[dict[str, Draft], Sequence[str]]:
    """Drafts of [NAME=]MAKE:MODEL by name, and their order, in which a repeated one stands for a
    further joint."""
    drives: dict[str, Draft] = {}
    order = []
    for given in models:
        name, _, model = given.rpartition("=")
        drafted = model_of(model)
        order.append(name or drafted.model)
        if drives.setdefault(order[-1], drafted) != drafted:
            raise ConfigurationError(f"--drive {given}: {order[-1]} names another model already")
    return drives, order


def _named(sheet: str) -> tuple[str, Path]:
    """Profile name and path from NAME=FILE, or from FILE, whose stem becomes the name."""
    name, equals, file = sheet.rpartition("=")
    if not equals or Path(sheet).is_file():
        path = Path(sheet)
        return path.stem.lower().replace("-", "_").replace(" ", "_"), path
    if not name or not file:
        raise ConfigurationError(f"--eds {sheet}: must be NAME=FILE, or FILE")
    return name, Path(file)


def _by_hand(
    objects: Sequence[str], names: tuple[str, ...]
) -> dict[str, dict[str, tuple[int, int]]]:
    """Objects given by the user, by profile and quantity."""
    found: dict[str, dict[str, tuple[int, int]]] = {name: {} for name in names}
    for given in objects:
        where, _, place = given.rpartition("=")
        profile, _, quantity = where.rpartition(".")
        index, _, subindex = place.partition(":")
        try:
            numbers = int(index, 16), int(subindex or "0", 16)
        except ValueError:
            numbers = -1, -1
        if quantity not in RULES or numbers[0] < 0 or (profile and profile not in found):
            raise ConfigurationError(
                f"--object {given}: must be [NAME.]QUANTITY=INDEX[:SUB] in hexadecimal, as "
                f"{names[0]}.current=0x30D1:01; quantities are {', '.join(RULES)}"
            )
        for name in [profile] if profile else names:
            found[name][quantity] = numbers
    return found


def _refuse_clashes(given: Sequence[Path]) -> None:
    """Raise ConfigurationError if the copy of a file would overwrite another's, or a file that is
    written here."""
    taken: dict[str, Path] = {}
    for path in given:
        if path.name in WRITTEN:
            raise ConfigurationError(f"{path}: {path.name} is generated; give it another name")
        other = taken.setdefault(path.name, path)
        if other.resolve() != path.resolve():
            raise ConfigurationError(
                f"{path} and {other}: both are copied to one folder; give them different names"
            )


def _report(folder: Path, written: str, remarks: Sequence[str], *, guarded: bool) -> None:
    click.echo(f"wrote {folder / 'config.yaml'}: {guesses(written)} lines with CHECK hold guesses")
    for remark in remarks:
        say(remark)
    click.echo(
        f"""next:
  contactd check {folder}
    lists mistakes, and what follows from the configuration
  contactd check --explain FIELD
    explains a field and how to find it
  contactd scan {folder}
    lists the nodes on the bus
  contactd simulate {folder}
    simulates the arm of simulation.yaml, to rehearse"""
    )
    if guarded:
        click.echo(f"  contactd guard {folder}")
        say("    holds the arm, beside `contactd run`: these motors let go when they receive no "
            "frames")  # fmt: skip
