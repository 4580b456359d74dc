"""The arm in a hand: what it asks of one that leads it, and whether it goes on in one that rests.

    python -m bench.hand [--arms N] [--first SEED] [--part PART] [--as-configured] [--no-probe]
                         [--jobs N] [--json]

N arms as wide as the world, with the three laws of friction, each around a pose of its own, armed
after a minute of work, with the gains of `contactctl gain --balance`.

leads   A hand of 300, 1500 and 4000 N/m sets out each joint by itself, from rest, leads it by 0.3
        rad at 0.25 rad/s and lets go in motion; beside it the same arm with its drives off,
        weightless. Forces are those of a hand that holds the tool, at least 8 cm off the axis.
rests   Such a hand at the tool takes the arm from its trajectory, then rests with 0.2 to 0.9 of the
        level in force on the joint that it loads most, holds still for 30 s, and lets go; or lets
        go at once. A miss is a trajectory that goes on while the hand is there.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, get_args

import click
import numpy as np

from bench.options import JOBS, command
from bench.report import Target, plain, print_report
from bench.study.leading import Led, Rested, arm_at_work, lead, rest, robot_of
from bench.study.monte_carlo import spread
from daemon.modes.table import Event, Mode

Part = Literal["leads", "rests"]
PARTS: Final[tuple[Part, ...]] = get_args(Part)
WORK_S: Final = 60.0
HANDS_N_M: Final = (300.0, 1500.0, 4000.0)
SHARES: Final = (0.0, 0.2, 0.55, 0.9)  # 0: it lets go at once
TREMBLES: Final = 0.25
USUAL_S: Final = 2.2  # until an arm goes on that nothing touches


@dataclass(frozen=True, slots=True)
class Job:
    """One arm, and one part of the bench."""

    seed: int
    part: Part
    balanced: bool
    probes: bool = True


@dataclass(frozen=True, slots=True)
class Result:
    """What was seen of one arm."""

    job: Job
    led: list[Led]
    stuck: int  # joints that no force of a hand set out
    rested: list[Rested]


def run(job: Job) -> Result:
    """One arm."""
    robot = robot_of(balanced=job.balanced, probes=job.probes)
    held, rng = arm_at_work(robot, job.seed, WORK_S), np.random.default_rng((job.seed, 81))
    if job.part == "rests":
        trials = [rest(held, share, float(rng.choice(HANDS_N_M)), rng) for share in SHARES]
        return Result(job, [], 0, [each for each in trials if each is not None])
    held.on.request(Event.PAUSE)
    while held.on.mode is not Mode.HOLDING:
        held.on.step()
    found = [lead(held, joint, HANDS_N_M[job.seed // 3 % 3]) for joint in range(held.plant.n)]
    led = [each for each in found if each is not None]
    return Result(job, led, len(found) - len(led), [])


def targets(results: Sequence[Result]) -> list[Target]:
    """Figures against what a hand is to feel."""
    led = [each for result in results for each in result.led]
    rested = [each for result in results for each in result.rested]
    found: list[Target] = []
    if led:
        force = np.array([each.leads for each in led])
        work = np.array([each.work / each.work_off for each in led])
        sets_out = np.array([each.sets_out for each in led])
        found += [
            Target("sets out, worst joint", float(sets_out.max()), 4.0, "N"),
            Target("sets out, median", float(np.median(sets_out)), 4.0, "N"),
            Target("leads, worst joint", float(force.max()), 6.0, "N"),
            Target("leads, median", float(np.median(force)), 6.0, "N"),
            Target("work over that of drives off, median", float(np.median(work)), 1.8, "x"),
            Target("largest over smallest force", float(force.max() / force.min()), 2.0, "x"),
            Target("coasts, furthest", 1e3 * max(each.coasts_rad for each in led), 20.0, "mrad"),
            Target("trembles", sum(each.tremble > TREMBLES for each in led), 0),
        ]
    if rested:
        there = [each for each in rested if each.share]
        alone = [each.let_go_s for each in rested if not each.share]
        missed = sum(each.missed for each in there)
        goes_on = float(np.mean([s <= USUAL_S for s in alone])) if alone else np.nan
        stays = sum(bool(np.isinf(each.let_go_s)) for each in there)
        found += [
            Target("goes on in a hand that rests", 100.0 * missed / len(there), 5.0, "%"),
            Target("goes on as usual without one", 100.0 * goes_on, 99.0, "%", "higher"),
            Target("waits on after it left", 100.0 * stays / len(there), 1.0, "%"),
        ]
    return found


def by_joint(results: Sequence[Result]) -> dict[str, Any]:
    """Median and range of each joint: force to set out, to lead, with the drives off [N]; the ratio
    of the work; coasting [mrad]."""
    led = [each for result in results for each in result.led]
    rows: dict[str, Any] = {}
    for name in dict.fromkeys(each.joint for each in led):
        mine = [each for each in led if each.joint == name]
        columns = {
            "sets_out_N": [each.sets_out for each in mine],
            "leads_N": [each.leads for each in mine],
            "off_N": [each.leads_off for each in mine],
            "work": [each.work / each.work_off for each in mine],
            "coasts_mrad": [1e3 * each.coasts_rad for each in mine],
        }
        rows[name] = {
            key: np.round([min(value), np.median(value), max(value)], 2).tolist()
            for key, value in columns.items()
        }
    return rows


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=30)
@click.option("--first", type=click.IntRange(min=0), default=1)
@click.option("--part", type=click.Choice(PARTS), default=None, help="Only this part.")
@click.option("--as-configured", is_flag=True, help="With the gains of the configuration.")
@click.option("--no-probe", is_flag=True, help="With `admittance.probe: false`.")
@JOBS
def main(
    arms: int,
    first: int,
    part: Part | None,
    as_configured: bool,
    no_probe: bool,
    processes: int,
    as_json: bool,
) -> None:
    parts = PARTS if part is None else (part,)
    jobs = [
        Job(seed, each, not as_configured, not no_probe)
        for each in parts
        for seed in range(first, first + arms)
    ]
    done = spread(run, jobs, processes, "arms")
    results = sorted(done, key=lambda result: jobs.index(result.job))
    rested = [asdict(each) for result in results for each in result.rested]
    data = {
        "joints": by_joint(results),
        "stuck": sum(result.stuck for result in results),
        "missed": [row for row in rested if row["share"] and np.isfinite(row["went_on_s"])],
        "rested": rested if as_json else len(rested),
    }
    print_report("hand", first, targets(results), plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
