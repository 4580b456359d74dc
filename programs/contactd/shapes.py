"""`contactd shapes`: its options."""

from pathlib import Path
from typing import Any

import click

from programs.command_line.options import PATH


@click.command()
@click.argument("config", type=PATH)
@click.option(
    "--from", "source", type=click.Choice(["collision", "visual", "inertial"]),
    help="Geometry of the URDF; by default the first of these that it has.",
)  # fmt: skip
@click.option("--single", is_flag=True, help="Never two capsules for a link: fewer pairs.")
@click.option(
    "--force", is_flag=True,
    help="Replace a file that is there; its margin, and capsules of names of your own, stay.",
)  # fmt: skip
def shapes(config: Path, source: Any, single: bool, force: bool) -> None:
    """Fit capsules to the links of CONFIG's URDF and write them to shapes.yaml beside it: with that
    file, setpoints are bounded so that links keep apart from each other, and from the planes and
    boxes of surroundings.yaml.

    Pairs that touch always, often or never, by sampled poses, are left out and listed.
    """
    from programs.contactd.fitting import write_shapes  # noqa: PLC0415 - `--help` starts at once

    write_shapes(config, source, force=force, single=single)
