"""Mistakes of a newcomer: what `contactd check` tells of them, planted one at a time.

    python -m bench.newcomer [--arms N] [--json]

Every mistake of `bench/study/mistakes.py` that files can show is planted alone into one generated
arm of each of six makes of drives, and looked for at the field that is wrong; N arms without a
mistake must pass without a warning. It takes about a minute of CPU time.
"""

import tempfile
from pathlib import Path
from typing import Any

import click

from bench.report import Target, print_report
from bench.rigs.generated_arms import GeneratedArm, generate
from bench.rigs.generated_makes import MAKES
from bench.study.mistakes import MISTAKES, checkable, told

LEAST = 57


def planted(arm: GeneratedArm, folder: Path) -> dict[str, Any]:
    """What became of the mistakes in one arm: how many were told at their field, how many refused,
    and the words of those that were missed."""
    missed, refused = [], 0
    for mistake in checkable():
        said = told(mistake.plant(arm, folder))
        refused += said.refused
        if not said.of(mistake.field):
            missed.append(mistake.words)
    there = sum(not mistake.only_wiring for mistake in MISTAKES)
    return {
        "make": arm.make.name,
        "told": there - len(missed),
        "refused": refused,
        "missed": missed,
    }


@click.command()
@click.option("--arms", default=20, show_default=True, type=click.IntRange(1, 1000))
@click.option("--json", "as_json", is_flag=True)
def main(arms: int, as_json: bool) -> None:
    """Plant every mistake into an arm of each make, and none into N arms."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "arm"
        found = [planted(generate(seed), folder) for seed in range(len(MAKES))]
        clean = [told(generate(seed).write(folder)) for seed in range(arms)]
    if not as_json:
        for one in found:
            missed = "; ".join(one["missed"]) or "none"
            click.echo(
                f"{one['make']}: {one['told']} told, {one['refused']} refused; missed: {missed}"
            )
    warned = sum(bool(said.lines) for said in clean)
    targets = [
        Target("mistakes told at the right field, at least, of 60", min(f["told"] for f in found),
               LEAST, "", "higher"),
        Target(f"arms without mistakes that are warned of, of {arms}", warned, 0, "", "lower"),
    ]  # fmt: skip
    print_report("newcomer", 0, targets, {"makes": found}, as_json=as_json)


if __name__ == "__main__":
    main()
