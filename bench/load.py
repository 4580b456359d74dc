"""Loads in the hand, and hands that are none, over arms as wide as the world.

    python -m bench.load [--arms N] [--armed-arms N] [--hand-minutes N]
                         [--part load|armed|hand|all] [--jobs N] [--seed N] [--json]

load  N arms take 0.2 kg, and N arms 0.5 kg, after two minutes at work with nobody there: when it is
      recognised (seconds of motion of joints that carry it), with what mass, and what the residual
      is with the load told, over that of the same motion without it.
armed N arms are armed after a minute at work, and take these loads while their trajectory runs:
      they yield, and hardly move. Seconds until it is said what to do if it is a load, and until
      it is recognised; an arm that cannot go on is started.
hand  hands push, lead, lean on and pull at arms at work; pulls straight down at the hand change by
      a quarter or more. What is taken for a load.

Arms are those of `bench.false_contacts`, simulated without a bus.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final, Literal, get_args

import click
import numpy as np

from bench.options import FIRST_SEED, JOBS, command
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO
from bench.study.armed_loads import ArmedJob, ArmedResult, armed_load
from bench.study.loads import FREE_S, TOUCHES, HandJob, LoadJob, LoadResult, Recognised, hand, load
from bench.study.monte_carlo import spread
from bench.study.world import LAWS

Part = Literal["load", "armed", "hand", "all"]
MASSES: Final = (0.2, 0.5)  # [kg]
WITHIN_S: Final = 10.0
WORKED_S, SAID_S = 60.0, 15.0  # armed: at work before, and said what to do within
HAND_S: Final = 300.0


def load_targets(results: Sequence[LoadResult]) -> list[Target]:
    """Recognised in time, with its mass; and told, nothing is left of it."""
    rows = []
    for mass, share in zip(MASSES, (95.0, 100.0), strict=True):
        judged = [r for r in results if r.given == mass and r.enough]
        within = [r for r in judged if r.found_s is not None and r.found_s <= WITHIN_S]
        found = [r for r in results if r.given == mass and r.found_s is not None]
        name = f"{mass:g} kg recognised within {WITHIN_S:g} s of motion, of {len(judged)} arms"
        rows.append(Target(name, 100.0 * len(within) / len(judged), share, "%", "higher"))
        first, later = [r.mass for r in found], [r.confirmed for r in found]
        for said, every in (("first said", first), ("confirmed", later)):
            masses = np.array(every)[~np.isnan(every)]
            wrong = int(np.sum(np.abs(masses - mass) > max(0.15 * mass, 0.05)))
            name = f"{mass:g} kg: masses {said} off by more than 15 % and 50 g, of {len(masses)}"
            rows.append(Target(name, wrong, 0))
        ratios = np.array([r.ratio for r in results if r.given == mass])
        name = f"{mass:g} kg told: rms of r over that without it, median"
        rows.append(Target(name, float(np.median(ratios)), 1.1, "x"))
        name = f"{mass:g} kg told: the same, 95 % of the arms"
        rows.append(Target(name, float(np.percentile(ratios, 95)), 1.1, "x"))
    before = sum(r.told_before for r in results)
    rows.append(Target("loads recognised before there was one", before, 0))
    return rows


def armed_targets(results: Sequence[ArmedResult]) -> list[Target]:
    """Said in time, though the arm yields."""
    rows = []
    for mass in MASSES:
        judged = [r for r in results if r.job.mass == mass]
        told = [r.hinted_s if r.hinted_s is not None else r.found_s for r in judged]
        said = [s for s in told if s is not None and s <= SAID_S]
        name = f"armed, {mass:g} kg: said what to do within {SAID_S:g} s, of {len(judged)} arms"
        rows.append(Target(name, 100.0 * len(said) / len(judged), 95.0, "%", "higher"))
    before = sum(r.told_before for r in results)
    rows.append(Target("armed: loads recognised before there was one", before, 0))
    return rows


def loads(arms: int, seed: int, processes: int) -> list[LoadResult]:
    """Arms with each mass."""
    todo = [LoadJob(ROMEO, LAWS[k % len(LAWS)], seed + k, MASSES) for k in range(arms)]
    found = [result for one in spread(load, todo, processes, "loads") for result in one]
    return sorted(found, key=lambda r: (r.given, r.job.seed))


def armed_loads(arms: int, seed: int, processes: int) -> list[ArmedResult]:
    """Arms that are armed, with each mass."""
    todo = [
        ArmedJob(ROMEO, LAWS[(seed + k) % len(LAWS)], seed + 3000 + k, mass, WORKED_S)
        for mass in MASSES
        for k in range(arms)
    ]
    done = spread(armed_load, todo, processes, "armed arms")
    return sorted(done, key=lambda r: (r.job.mass, r.job.seed))


def hands(minutes: float, seed: int, processes: int) -> list[tuple[HandJob, list[Recognised]]]:
    """Arms that are touched for so long altogether."""
    count = max(round(60.0 * minutes / HAND_S), len(TOUCHES))
    todo = [
        HandJob(ROMEO, LAWS[k % len(LAWS)], seed + 1000 + k, TOUCHES[k % len(TOUCHES)],
                60.0 * minutes / count)
        for k in range(count)
    ]  # fmt: skip
    return sorted(spread(hand, todo, processes, "hands"), key=lambda one: one[0].seed)


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=100)
@click.option("--armed-arms", type=click.IntRange(min=1), default=12)
@click.option("--hand-minutes", type=click.FloatRange(min=1), default=60.0)
@click.option("--part", type=click.Choice(get_args(Part)), default="all")
@JOBS
@FIRST_SEED
def main(
    arms: int,
    armed_arms: int,
    hand_minutes: float,
    part: Part,
    processes: int,
    seed: int,
    as_json: bool,
) -> None:
    targets: list[Target] = []
    data: dict[str, Any] = {"free_s": FREE_S}
    if part in ("load", "all"):
        results = loads(arms, seed, processes)
        targets += load_targets(results)
        data["loads"] = [_plain(r) for r in results]
    if part in ("armed", "all"):
        armed = armed_loads(armed_arms, seed, processes)
        targets += armed_targets(armed)
        data["armed"] = [_plain(r) for r in armed]
    if part in ("hand", "all"):
        touched = hands(hand_minutes, seed, processes)
        taken = [(job.touch, job.seed, asdict(found)) for job, one in touched for found in one]
        name = f"hands taken for a load in {hand_minutes:g} minutes"
        targets.append(Target(name, len(taken), 0))
        data["hands"] = taken
    print_report("load", seed, targets, data, as_json=as_json)


def _plain(result: LoadResult | ArmedResult) -> dict[str, Any]:
    """For JSON: without the folder of its job."""
    plain = asdict(result)
    plain |= plain.pop("job")
    del plain["robot"]
    return plain


if __name__ == "__main__":
    main()
