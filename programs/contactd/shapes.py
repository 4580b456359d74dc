"""Command `contactd shapes`."""

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
@click.option("--single", is_flag=True, help="One capsule per link, for fewer pairs.")
@click.option(
    "--force", is_flag=True,
    help="Replace an existing file, keeping its margin and the capsules that you added.",
)  # fmt: skip
def shapes(config: Path, source: Any, single: bool, force: bool) -> None:
    """Fit capsules to the links of CONFIG's URDF and write them to shapes.yaml beside it. With that
    file, setpoints are bounded so that links keep a distance from each other and from the planes
    and boxes of surroundings.yaml.

    Pairs that touch always, often or never in sampled poses are left out and listed.
    """
    from programs.contactd.fitting import write_shapes  # noqa: PLC0415 - `--help` starts at once

    write_shapes(config, source, force=force, single=single)
