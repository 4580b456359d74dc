"""Loads in the hand, hands that are none, and gears that wear, over arms as wide as the world.

    python -m bench.load [--arms N] [--armed-arms N] [--hand-minutes N] [--wear-arms N] [--days N]
                         [--day-minutes X] [--part load|armed|hand|steady|wear|all] [--jobs N]
                         [--seed N] [--json]

load  N arms take 0.2 kg, and N arms 0.5 kg, after two minutes at work with nobody there: when it is
      recognised (seconds of motion of joints that carry it), with what mass, and what the residual
      is with the load told, over that of the same motion without it.
armed N arms are armed after a minute at work, and take these loads while their trajectory runs:
      they yield, and hardly move. Seconds until it is said what to do if it is a load, and until
      it is recognised; an arm that cannot go on is started.
hand  hands push, lead, lean on and pull at arms at work; pulls straight down at the hand change by
      a quarter or more. What is taken for a load.
steady  hands pull straight down at armed-arms arms at work, with forces that change by 2 to 15 %
      (root mean square): how many are taken for a load, and of how many that is confirmed.
wear  one joint of N arms wears (gap doubles, friction +30 % in 30 days), none of N others; every
      day the arm works for X minutes. Which joint is named, and when.

Arms are those of `bench.false_contacts`, simulated without a bus. The day of the wear is shorter
than a real one: a day of 20 minutes shows a gap ten times as often as one of two.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final, Literal, get_args

import click
import numpy as np

from bench.options import FIRST_SEED, JOBS, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import ROMEO
from bench.study.armed_loads import ArmedJob, ArmedResult, armed_load
from bench.study.loads import (
    FREE_S,
    TOUCHES,
    HandJob,
    LoadJob,
    LoadResult,
    Recognised,
    hand,
    load,
)
from bench.study.monte_carlo import spread
from bench.study.steady_hands import CHANGES, SteadyResult, steady_hand
from bench.study.wear import WearJob, WearResult, wear
from bench.study.world import LAWS
from daemon.config.load import load_robot

Part = Literal["load", "armed", "hand", "steady", "wear", "all"]
MASSES: Final = (0.2, 0.5)
"""[kg]"""
WITHIN_S: Final = 10.0
WORKED_S, SAID_S = 60.0, 15.0
"""armed: at work before, and said what to do within"""
NAMED_BY: Final = 10
"""days"""
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
            rows.append(Target(name, wrong, 0, "", "lower"))
        ratios = np.array([r.ratio for r in results if r.given == mass])
        name = f"{mass:g} kg told: rms of r over that without it, median"
        rows.append(Target(name, float(np.median(ratios)), 1.1, "x", "lower"))
        name = f"{mass:g} kg told: the same, 95 % of the arms"
        rows.append(Target(name, float(np.percentile(ratios, 95)), 1.1, "x", "lower"))
    before = sum(r.told_before for r in results)
    rows.append(Target("loads recognised before there was one", before, 0, "", "lower"))
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
    rows.append(Target("armed: loads recognised before there was one", before, 0, "", "lower"))
    return rows


def wear_targets(results: Sequence[WearResult], joints: Sequence[str]) -> list[Target]:
    """The right joint is named in time, and no other."""
    worn = [r for r in results if r.job.joint >= 0]
    new = [r for r in results if r.job.joint < 0]
    right = sum(r.named.get(joints[r.job.joint], NAMED_BY + 1) <= NAMED_BY for r in worn)
    others = sum(bool(set(r.named) - {joints[r.job.joint]}) for r in worn)
    rows = []
    if worn:
        name = f"wear named by day {NAMED_BY} on its joint, of {len(worn)} arms"
        rows.append(Target(name, 100.0 * right / len(worn), 95.0, "%", "higher"))
        rows.append(Target("of these arms, other joints named", others, 0, "", "lower"))
    name = f"arms that do not age and are named, of {len(new)}"
    rows.append(Target(name, sum(bool(r.named) for r in new), 0, "", "lower"))
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


def steady_hands(arms: int, seed: int, processes: int) -> list[SteadyResult]:
    """Arms that are pulled at, with every steadiness."""
    todo = [HandJob(ROMEO, LAWS[k % len(LAWS)], seed + 4999 + k, "pull", 0.0) for k in range(arms)]
    return [one for arm in spread(steady_hand, todo, processes, "steady hands") for one in arm]


def steady_targets(results: Sequence[SteadyResult]) -> list[Target]:
    """None is a load: the least steady should not be taken for one, the others not confirmed."""
    rows = []
    for changes in CHANGES:
        pulls = [r for r in results if r.changes == changes]
        name = f"pulls that change by {100 * changes:g} %, of {len(pulls)}: taken for a load"
        rows.append(Target(name, sum(r.found_s is not None for r in pulls), 0, "", "lower"))
        name = f"pulls that change by {100 * changes:g} %: confirmed"
        rows.append(Target(name, sum(r.confirmed_s is not None for r in pulls), 0, "", "lower"))
    return rows


def wears(
    arms: int, days: int, minutes: float, seed: int, processes: int
) -> tuple[list[WearResult], list[str]]:
    """Arms of which one joint with a gap wears, until it must have been named; and as many that do
    not age, for all days."""
    c = load_robot(ROMEO).configuration
    with_gap = [i for i, joint in enumerate(c.joints) if joint.half_gap > 0.0]
    todo = [
        WearJob(ROMEO, LAWS[k % len(LAWS)], seed + 2000 + k, joint, length, 60.0 * minutes)
        for k in range(arms)
        for joint, length in ((with_gap[k % len(with_gap)], min(days, NAMED_BY)), (-1, days))
    ]
    done = spread(wear, todo, processes, "days of gears")
    return sorted(done, key=lambda r: (r.job.joint, r.job.seed)), c.joint_names


@click.command(help=help_of(__doc__))
@click.option("--arms", type=click.IntRange(min=1), default=100, show_default=True)
@click.option("--armed-arms", type=click.IntRange(min=1), default=12, show_default=True)
@click.option("--hand-minutes", type=click.FloatRange(min=1), default=60.0, show_default=True)
@click.option("--wear-arms", type=click.IntRange(min=1), default=40, show_default=True)
@click.option("--days", type=click.IntRange(min=1), default=30, show_default=True)
@click.option("--day-minutes", type=click.FloatRange(min=1), default=4.0, show_default=True)
@click.option("--part", type=click.Choice(get_args(Part)), default="all")
@JOBS
@FIRST_SEED
@click.option("--json", "as_json", is_flag=True)
def main(
    arms: int,
    armed_arms: int,
    hand_minutes: float,
    wear_arms: int,
    days: int,
    day_minutes: float,
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
        targets.append(Target(name, len(taken), 0, "", "lower"))
        data["hands"] = taken
    if part in ("steady", "all"):
        pulls = steady_hands(armed_arms, seed, processes)
        targets += steady_targets(pulls)
        data["steady"] = [asdict(r) for r in pulls]
    if part in ("wear", "all"):
        aged, joints = wears(wear_arms, days, day_minutes, seed, processes)
        targets += wear_targets(aged, joints)
        data["wear"] = [_plain(r) for r in aged]
        data["days"], data["day_minutes"] = days, day_minutes
    print_report("load", seed, targets, data, as_json=as_json)


def _plain(result: LoadResult | ArmedResult | WearResult) -> dict[str, Any]:
    """For JSON: the job without its folder, None for what is no number."""
    plain = asdict(result)
    plain |= {key: value for key, value in plain.pop("job").items() if key != "robot"}
    return {
        key: None if isinstance(value, float) and np.isnan(value) else value
        for key, value in plain.items()
    }


if __name__ == "__main__":
    main()
