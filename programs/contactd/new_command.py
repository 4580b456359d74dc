"""Command `contactd new`."""
# ruff: noqa: PLC0415 - imports inside the command, so that `--help` starts at once

from pathlib import Path

import click

from programs.command_line.options import PATH

Texts = tuple[str, ...]


@click.command()
@click.argument("folder", type=PATH, metavar="DIR")
@click.option("--urdf", type=PATH, required=True, metavar="FILE", help="URDF of the arm.")
@click.option(
    "--eds",
    "sheets",
    multiple=True,
    metavar="[NAME=]FILE",
    help="Electronic data sheet of CANopen drives; may be repeated, joint by joint.",
)
@click.option(
    "--drive",
    "models",
    multiple=True,
    metavar="[NAME=]MAKE:MODEL",
    help="Model of motors without an EDS, e.g. robstride:RS02; may be repeated, joint by joint.",
)
@click.option(
    "--object",
    "objects",
    multiple=True,
    metavar="[NAME.]QUANTITY=INDEX[:SUB]",
    help="Object of a quantity that the EDS alone does not determine; may be repeated.",
)
@click.option("--log-only", is_flag=True, help="No drives: the arm is known from logs alone.")
@click.argument("logs", type=PATH, nargs=-1, metavar="[LOG]...")
def new(
    folder: Path, urdf: Path, sheets: Texts, models: Texts, objects: Texts, log_only: bool,
    logs: tuple[Path, ...],
) -> None:  # fmt: skip
    """Write a configuration for a new arm into a new folder DIR, from its URDF and its drives:
    either their EDS or their models. If several are given, they are assigned to the joints in
    order; the remaining joints get the last one.

    Missing values are guessed and marked `# CHECK`, so that the arm can be checked and simulated
    at once. Nothing is overwritten.

    With --log-only there are no drives: the columns of each LOG are guessed from their names and
    values, shown, and written to a file beside it (docs/logs.md).
    """
    if log_only is not bool(logs) or (log_only and (sheets or models or objects)):
        raise click.UsageError("--log-only takes logs, and neither --eds, --drive nor --object")
    if log_only:
        from programs.contactd.new_log import new_log_arm

        new_log_arm(folder, urdf, logs)
        return
    from programs.contactd.new import new_arm

    new_arm(folder, urdf, sheets, objects, models)
