"""Options of benches, and their help."""

import os
import re
from collections.abc import Callable

import click

from bench.study.world import GEARS, LAWS

JOBS = click.option(
    "--jobs",
    "processes",
    type=click.IntRange(min=1),
    default=os.cpu_count(),
    show_default="all processors",
)
SEED = click.option("--seed", type=click.IntRange(min=0), default=1)
FIRST_SEED = click.option(
    "--seed", type=click.IntRange(min=0), default=1, help="Of the first arm; the others follow."
)
FRICTION = click.option(
    "--friction",
    "laws",
    type=click.Choice([*LAWS, "all"]),
    default="all",
    callback=lambda _context, _option, law: LAWS if law == "all" else (law,),
)
GEAR = click.option("--gears", default="modelled", type=click.Choice(GEARS))


def command(doc: str | None) -> Callable[[Callable[..., None]], click.Command]:
    """Command of a bench that reports: its help is its module's docstring, `--json` its last
    option. Defaults are shown."""

    def made(main: Callable[..., None]) -> click.Command:
        shown = {"show_default": True}
        bench = click.command(help=help_of(doc), context_settings=shown)(main)
        bench.params.append(click.Option(["--json", "as_json"], is_flag=True))
        return bench

    return made


def help_of(doc: str | None) -> str:
    r"""Help that a module's docstring gives: indented paragraphs keep their lines (`\b`)."""
    return re.sub(r"\n\n(?= {4})", "\n\n\b\n", doc or "")
