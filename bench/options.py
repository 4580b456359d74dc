"""Options of benches, and their help."""

import os
import re

import click

JOBS = click.option(
    "--jobs",
    "processes",
    type=click.IntRange(min=1),
    default=os.cpu_count(),
    show_default="all processors",
)
SEED = click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
FIRST_SEED = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Of the first arm; the others follow.",
)


def help_of(doc: str | None) -> str:
    r"""Help that a module's docstring gives: indented paragraphs keep their lines (`\b`)."""
    return re.sub(r"\n\n(?= {4})", "\n\n\b\n", doc or "")
