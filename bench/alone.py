"""Motion without a person: armed arms that learned what is no longer true.

    python -m bench.alone [--arms N] [--first SEED] [--kind KIND] [--retract] [--light]
                          [--jobs N] [--json]

N arms as wide as the world, with the three laws of friction and gains of 0.1 to 5 rad/s per Nm, or
their own, swing with all joints for four minutes, armed. Then each meets one change: something that
rubs, both ways, one way or with the motion, leans on it for 1 to 20 minutes, or pulls at a place
like a cable, all with 0.2 to 0.9 of a joint's stated level; friction that steps to 0.5 to 2 times
itself, or grows by half in a rest; a load that comes and goes; lost samples. After that it is
untouched. With --light they assist a hand, and have a guide, a line. The whole tick runs, around an
arm without a bus.

Judged by the plant. *Alone* is a joint whose rotor moves faster than 0.02 rad/s while the arm
yields, and no person does work on it, nor did half a second ago; what is left of the speed with
which it began to yield is no distance. A contact is false if no person touches; a change may cost
one when it comes, and one when it goes. Touches of half a second and twice the level in force
before the change come when it is gone (10 s after; 120 s after friction has changed), 15 s apart,
in motion, once the joint has been beyond its gap for 0.3 s, and are compared with touches of the
same arm without the change; touches that this one misses, too, are subtracted. The level is that in
motion 130 s after the change is over, over that of the arm without it, or with it from the
beginning where it lasts: other friction needs another level.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import click

from bench.options import JOBS, command
from bench.report import Target, plain, print_report
from bench.study import changes
from bench.study.alone import Job, arm_of, course
from bench.study.changes import KINDS, LASTING, Change, Kind
from bench.study.monte_carlo import spread
from daemon.modes.contact_reactions import ContactReaction

LATER_S = 0.15  # than usual, from which on a touch is missed


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of one arm."""

    job: Job
    change: Change
    own: bool
    alone_s: float
    alone_rad: float
    false: tuple[int, int]  # contacts when the change came, and when it went
    missed: int
    """touches that were not felt, or more than 150 ms later than the latest on the same arm without
    the change, less those that this one did not feel"""
    touched: int
    level: float  # 130 s after the change, over that of the arm without it, or always with it
    faults: int


def run(job: Job) -> Result:
    """One arm with its change, and without."""
    robot, _, own = arm_of(job.seed)
    change = changes.draw(job.kind, robot.configuration, job.seed)
    seen, false, level = course(job, change, happens=True)
    other, _, usual = course(job, change, happens=False)
    if change.kind in LASTING:
        _, _, usual = course(job, change, happens=False, always=True)
    return Result(
        job=job,
        change=change,
        own=own,
        alone_s=seen.alone_s,
        alone_rad=seen.alone_rad,
        false=false,
        missed=missed(seen.felt, other.felt),
        touched=len(seen.felt),
        level=level / usual,
        faults=seen.faults,
    )


def missed(delays: Sequence[float], usual: Sequence[float]) -> int:
    """Touches missed [s]: more than 150 ms later than the latest of the `usual` ones, less those
    that these miss, which are infinite."""
    latest = max(filter(math.isfinite, usual), default=0.0)
    late = sum(delay > latest + LATER_S for delay in delays)
    return max(int(late) - sum(map(math.isinf, usual)), 0)


def targets(results: Sequence[Result]) -> list[Target]:
    """Nothing moves alone, and nothing that a person did is unlearned."""
    own = [r.alone_rad for r in results if r.own]
    return [
        Target("longest motion alone", max(r.alone_s for r in results), 0.3, "s"),
        Target("furthest motion alone, own gains", max(own, default=0.0), 0.02, "rad"),
        Target("false contacts of one change", max(max(r.false) for r in results), 1),
        Target("touches missed", sum(r.missed for r in results), 0),
        Target("level afterwards, largest", max(r.level for r in results), 1.2, "times"),
        Target("faults", sum(r.faults for r in results), 0),
    ]


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=36)
@click.option("--first", type=click.IntRange(min=0), default=1)
@click.option("--kind", type=click.Choice(KINDS), default=None, help="Only this kind of change.")
@click.option("--retract", is_flag=True, help="Arms that back away from contacts.")
@click.option("--light", is_flag=True, help="Arms that assist a hand along a line.")
@JOBS
def main(
    arms: int, first: int, kind: Kind | None, retract: bool, light: bool, processes: int,
    as_json: bool,
) -> None:  # fmt: skip
    reaction = ContactReaction.RETRACT if retract else ContactReaction.ADMITTANCE
    seeds = range(first, first + arms)
    jobs = [Job(seed, kind or KINDS[seed % len(KINDS)], reaction, light) for seed in seeds]
    results = sorted(spread(run, jobs, processes, "arms"), key=lambda result: result.job.seed)
    data = {"arms": [plain(asdict(result), 4) for result in results]}
    print_report("alone", first, targets(results), data, as_json=as_json)


if __name__ == "__main__":
    main()
