"""The paper's figures, re-made on the simulated arm over the virtual bus.

\b
    python -m bench.paper [--figure N ...] [--seed N] [--json]

"The paper" is Contact Detection and Physical Interaction on Low Cost Personal Robots. Pictures
(PNG) and all numbers (JSON) go to bench/out/paper/; docs/paper.md explains them. Figures 9 and 11
are one experiment and come together. All of them take about two minutes on a quiet machine.
"""

import json
import shutil
import time
from dataclasses import asdict
from pathlib import Path

import click

from bench.options import command
from bench.paper import figure_02, figure_08, figure_13, figures_09_11
from bench.paper.figure import save
from bench.report import print_report

EXPERIMENTS = {
    ("2",): figure_02.make,
    ("8",): figure_08.make,
    ("9", "11"): figures_09_11.make,
    ("13",): figure_13.make,
}
NUMBERS = [number for numbers in EXPERIMENTS for number in numbers]
OUT = Path(__file__).parent.parent / "out" / "paper"
DOCS = Path(__file__).parents[2] / "docs" / "paper"


@command(__doc__)
@click.option(
    "--figure",
    "chosen",
    type=click.Choice(NUMBERS),
    multiple=True,
    help="Only this one; may be given several times.",
)
@click.option("--seed", default=1, help="Of the plant's mismatch and noise.")
@click.option("--docs", is_flag=True, help="Renew the pictures of docs/paper.md as well.")
def main(chosen: tuple[str, ...], seed: int, *, as_json: bool, docs: bool) -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    tables, targets = {}, []
    for numbers, make in EXPERIMENTS.items():
        if chosen and not set(chosen) & set(numbers):
            continue
        begun = time.perf_counter()
        made = make(seed)
        for name, figure in made.pictures.items():
            path = OUT / f"{name}.png"
            save(figure, path)
            if docs and (DOCS / path.name).exists():
                shutil.copy(path, DOCS)
            click.echo(f"{path}  ({time.perf_counter() - begun:.0f} s)", err=True)
        name = " and ".join(numbers)
        tables[name] = made.table
        targets += made.targets
        file = {"figure": name, "seed": seed, "targets": [asdict(t) for t in made.targets]}
        path = OUT / f"figure_{'_'.join(number.zfill(2) for number in numbers)}.json"
        path.write_text(json.dumps({**file, "table": made.table}, indent=1) + "\n")
    print_report("paper", seed, targets, {"figures": tables}, as_json=as_json)


if __name__ == "__main__":
    main()
