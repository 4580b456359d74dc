"""The arm in a hand: what it asks of one that leads it, and whether it goes on in one that rests.

    python -m bench.hand [--arms N] [--first SEED] [--part PART]
                         [--no-probe] [--assist] [--circle PNG] [--jobs N]
                         [--json]

N arms as wide as the world, with the three laws of friction, each around a pose of its own, armed
after a minute of work, with the gains of `contactctl gain --balance`.

    leads   A hand of 1000, 1500 or 4000 N/m sets out each joint by itself,
            from rest, leads it by 0.3 rad at 0.25 rad/s and lets go in
            motion; beside it the same arm with its drives off, weightless.
            Forces are those of a hand that holds the tool, at least 8 cm
            off the axis.
    rests   One of 300, 1500 or 4000 N/m at the tool takes the arm from its
            trajectory, then rests with 0.2 to 0.9 of the level in force on
            the joint that it loads most, holds still for 30 s, and lets go;
            or lets go at once. A miss is a trajectory that goes on while
            the hand is there.
    pulled  A steady torque of 1.2 times what sets a joint out, as of a load
            or a cable, for 3 s.
    guide   Romeo's arm, OpenArm's and the beam arm, with Romeo's drives, on
            a line along an axis of the tool: 20 N press across, along each
            held axis that the drives can stand; then a hand of 1500 N/m
            leads the tool along by 0.1 m at 0.05 m/s, with the guide and
            without; then an obstacle is where the hand was, on the way of
            the spring. Not by default.

--circle draws instead the circle of a hand at the tool of the first arm, and its force, as a PNG.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

import click
import numpy as np

from bench.options import JOBS, command
from bench.report import Target, plain, print_report
from bench.study.guided import ARMS, Guided, guided
from bench.study.leading import Led, Rested, arm_at_work, lead, pull, rest, robot_of
from bench.study.monte_carlo import spread
from daemon.modes.table import Event, Mode

Part = Literal["leads", "rests", "pulled", "guide"]
PARTS: Final[tuple[Part, ...]] = get_args(Part)
USUAL: Final = PARTS[:3]
WORK_S: Final = 60.0
HANDS_N_M: Final = (300.0, 1500.0, 4000.0)
LEADING_N_M: Final = (1000.0, 1500.0, 4000.0)  # softer ones lag by more than they lead
SHARES: Final = (0.0, 0.2, 0.55, 0.9)  # 0: it lets go at once
TREMBLES: Final = 0.25
SETS_OUT_N: Final = 4.0
USUAL_S: Final = 2.2  # until an arm goes on that nothing touches


@dataclass(frozen=True, slots=True)
class Job:
    """One arm, and one part of the bench."""

    seed: int
    part: Part
    probes: bool = True
    assists: bool = False


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one arm."""

    job: Job
    led: list[Led]
    rested: list[Rested]
    carried: dict[str, float]
    """of each joint that a steady torque set out [rad]"""
    guided: list[Guided] = field(default_factory=list)


def run(job: Job) -> Result:
    """One arm."""
    if job.part == "guide":
        return Result(job, [], [], {}, [guided(arm, job.seed, WORK_S / 6.0) for arm in ARMS])
    rng = np.random.default_rng((job.seed, 81))
    on = arm_at_work(robot_of(probes=job.probes, assists=job.assists), job.seed, WORK_S)
    if job.part == "rests":
        trials = [rest(on, share, float(rng.choice(HANDS_N_M)), rng) for share in SHARES]
        return Result(job, [], [each for each in trials if each is not None], {})
    on.request(Event.PAUSE)
    while on.mode is not Mode.HOLDING:
        on.step()
    if job.part == "pulled":
        ways = {name: pull(on, i) for i, name in enumerate(on.drives.names)}
        return Result(job, [], [], {name: way for name, way in ways.items() if way is not None})
    found = [lead(on, i, LEADING_N_M[job.seed // 3 % 3]) for i in range(len(on.drives.names))]
    return Result(job, [each for each in found if each is not None], [], {})


def targets(results: Sequence[Result]) -> list[Target]:
    """Figures against what a hand is to feel."""
    led = [each for result in results for each in result.led]
    rested = [each for result in results for each in result.rested]
    found: list[Target] = []
    if led:
        force, sets_out = (np.array([getattr(e, x) for e in led]) for x in ("leads", "sets_out"))
        work = [each.work / each.work_off for each in led]
        found += [
            Target("sets out, worst joint", float(sets_out.max()), SETS_OUT_N, "N"),
            Target("sets out beyond that, unnamed", sum(not forbids(e) for e in heavy(led)), 0),
            Target("leads, worst joint", float(force.max()), 6.0, "N"),
            Target("work over that of drives off, median", float(np.median(work)), 1.8, "x"),
            Target("largest over smallest force", float(force.max() / force.min()), 2.0, "x"),
            Target("coasts, furthest", 1e3 * max(each.coasts_rad for each in led), 20.0, "mrad"),
            Target("springs back", 1e3 * max(each.rebounds_rad for each in led), 20.0, "mrad"),
            Target("trembles", sum(each.tremble > TREMBLES for each in led), 0),
        ]
    if there := [each for each in rested if each.share]:
        usual = [each.let_go_s <= USUAL_S for each in rested if not each.share]
        missed, stays = (sum(e.missed for e in there), sum(np.isinf(e.let_go_s) for e in there))
        found += [
            Target("goes on in a hand that rests", 100.0 * missed / len(there), 5.0, "%"),
            Target("goes on as usual without one", 100.0 * float(np.mean(usual)), 95.0, "%",
                   "higher"),
            Target("waits on after it left", 100.0 * float(stays) / len(there), 5.0, "%"),
        ]  # fmt: skip
    if lines := [line for result in results for line in result.guided]:
        beyond = np.array(
            [o - p for line in lines for o, p in zip(line.off, line.play, strict=True)]
        )
        found += [
            Target("held at 20 N, beyond play", float(np.nanmax(beyond)), 2.0, "mm"),
            Target("faulted on a guide", sum(bool(line.fault) for line in lines), 0),
        ]
    return found


def heavy(led: Sequence[Led]) -> list[Led]:
    """Joints that set out beyond what is asked for."""
    return [each for each in led if each.sets_out > SETS_OUT_N]


def forbids(each: Led) -> str:
    """Reason why a joint does not set out at less; empty: neither level nor friction."""
    if each.stated > SETS_OUT_N:
        return "stated level"
    return "friction" if each.stated + each.friction > SETS_OUT_N else ""


def by_joint(results: Sequence[Result]) -> dict[str, Any]:
    """Least, median and largest of each joint: force to set out, to lead, and that with the drives
    off [N], and the ratio of the work."""
    led = [each for result in results for each in result.led]
    rows: dict[str, Any] = {}
    for name in dict.fromkeys(each.joint for each in led):
        mine = [e for e in led if e.joint == name]
        table = np.array([(e.sets_out, e.leads, e.leads_off, e.work / e.work_off) for e in mine])
        least, median, most = table.min(axis=0), np.median(table, axis=0), table.max(axis=0)
        columns = np.round([least, median, most], 2).T.tolist()
        rows[name] = dict(zip(("sets_out_N", "leads_N", "off_N", "work"), columns, strict=True))
    return rows


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=27)
@click.option("--first", type=click.IntRange(min=0), default=1)
@click.option("--part", type=click.Choice(PARTS), default=None, help="Only this part.")
@click.option("--no-probe", is_flag=True, help="With `admittance.probe: false`.")
@click.option("--assist", is_flag=True, help="With `admittance.assist: true`.")
@click.option("--circle", type=click.Path(path_type=Path), default=None, help="Draw a circle.")
@JOBS
def main(
    arms: int, first: int, part: Part | None, no_probe: bool, assist: bool, circle: Path | None,
    processes: int, as_json: bool,
) -> None:  # fmt: skip
    if circle is not None:
        from bench.study.circle import circles  # noqa: PLC0415  # matplotlib takes a second

        print_report("hand", first, [], circles(first, WORK_S, circle), as_json=as_json)
        return
    parts, seeds = USUAL if part is None else (part,), range(first, first + arms)
    jobs = [Job(seed, each, not no_probe, assist) for each in parts for seed in seeds]
    done = spread(run, jobs, processes, "arms")
    results = sorted(done, key=lambda result: jobs.index(result.job))
    rested = [asdict(each) for result in results for each in result.rested]
    data = {
        "joints": by_joint(results),
        "carried_rad": {
            f"{result.job.seed} {joint}": way
            for result in results
            for joint, way in result.carried.items()
        },
        "guided": [asdict(line) for result in results for line in result.guided],
        "set_out_beyond": [
            [result.job.seed, each.joint, each.sets_out, each.stated, each.friction, forbids(each)]
            for result in results
            for each in heavy(result.led)
        ],
        "trials": len(rested),
        "missed": [row for row in rested if row["share"] and np.isfinite(row["went_on_s"])],
    }
    print_report("hand", first, targets(results), plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
