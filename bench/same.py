"""Results of the benches that judge the estimator, before and today, with the same seeds.

    python -m bench.same [--bench NAME ...] [--seeds N] [--minutes N] [--json]

Runs `bench.detection`, `bench.motor_position`, `bench.paper` and `bench.commissioning` on today's
code and on that of the last commit before the estimator's compiled kernel, both at once, and
compares their `--json` figure by figure. A figure differs by more than its noise where its mean
over the seeds has moved by more than it differs between seeds (so with one seed every difference
counts). The status is 1 if one does. All of it takes hours: begin with one bench.
"""

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from bench.report import Target, print_report
from bench.study.before import ROOT, code_before
from bench.study.figures import Verdict, figures, verdicts
from bench.study.pairs import named

BENCHES: Final = ("detection", "motor_position", "paper", "commissioning")
#: Those that run for `--minutes` on several processors.
POPULATIONS: Final = ("detection", "motor_position")


def arguments(bench: str, seed: int, minutes: float) -> list[str]:
    """Command line of a bench after `python`."""
    words = ["-m", f"bench.{bench}", "--json", "--seed", str(seed)]
    if bench in POPULATIONS:
        # Both codes share the processors.
        words += ["--minutes", f"{minutes:g}", "--jobs", str(max((os.cpu_count() or 1) // 2, 1))]
    return words


def reports(bench: str, codes: Sequence[Path], seed: int, minutes: float) -> list[dict[str, Any]]:
    """Reports of the bench on these codes, at once. Raises RuntimeError if one fails."""
    words = [sys.executable, *arguments(bench, seed, minutes)]
    running = [
        subprocess.Popen(
            words,
            cwd=code,
            env={**os.environ, "PYTHONPATH": str(code)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for code in codes
    ]
    said = [process.communicate()[0] for process in running]
    for process, code in zip(running, codes, strict=True):
        if process.returncode != 0:
            raise RuntimeError(f"bench.{bench} on {code} ended with status {process.returncode}")
    return [json.loads(text.splitlines()[-1]) for text in said]


def compared(bench: str, before: Path, seeds: Sequence[int], minutes: float) -> list[Verdict]:
    """Verdict on every figure of a bench."""
    pairs = [reports(bench, (before, ROOT), seed, minutes) for seed in seeds]
    return verdicts([figures(old) for old, _ in pairs], [figures(new) for _, new in pairs])


@click.command(help=__doc__)
@click.option("--bench", "chosen", type=click.Choice(BENCHES), multiple=True, help="Only this one.")
@click.option("--seeds", type=click.IntRange(1), default=3, show_default=True, help="From 1 on.")
@click.option("--minutes", default=4.0, show_default=True, help="Of benches over a population.")
@click.option("--json", "as_json", is_flag=True)
def main(chosen: tuple[str, ...], seeds: int, minutes: float, as_json: bool) -> None:
    targets: list[Target] = []
    data: dict[str, Any] = {}
    with code_before() as before:
        if before is None:
            raise click.ClickException("before: missing")
        click.echo(named(before), err=True)
        for bench in chosen or BENCHES:
            found = compared(bench, before, range(1, seeds + 1), minutes)
            apart = [str(verdict) for verdict in found if verdict.kind == "differs"]
            counts = Counter(verdict.kind for verdict in found)
            data[bench] = {**counts, "apart": apart}
            if not as_json:
                kinds = ", ".join(f"{counts[kind]} {kind}" for kind in ("same", "noise", "differs"))
                click.echo("\n  ".join([f"{bench}: {len(found)} figures, {kinds}", *apart]))
            name = f"figures of {bench} that differ by more than their noise"
            targets.append(Target(name, len(apart), 0, "", "lower"))
    told = {"before": named(before), "seeds": seeds, "minutes": minutes, **data}
    print_report("same", 1, targets, told, as_json=as_json)
    raise SystemExit(0 if all(target.met for target in targets) else 1)


if __name__ == "__main__":
    main()
