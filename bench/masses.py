"""Masses and loads identified on arms whose URDF is wrong.

    python -m bench.masses [--arms N] [--seconds S] [--jobs N] [--seed N] [--json]

Every mass of an arm is off by 20 %, every centre by 20 mm in any direction; friction up to 1.5
times, rotors 1.25 times. It moves without contact to have its masses identified, then its friction
with them; judged is the residual on another motion, to which nothing was fitted, beside that of the
same arm whose masses are known exactly. Then a load of 0.1 to 0.5 kg comes into its hand for ten
seconds. All this by drives that ramp from setpoint to setpoint, and again, by as many arms of each
sort, by drives that do not (bench/rigs/reaching.py), of whose current a part of the acceleration
is missing. Simulated without a bus; an arm takes some five seconds of CPU time.
"""

from typing import Any

import click
import numpy as np

from bench.options import JOBS, SEED, command
from bench.report import Target, print_report, summary
from bench.rigs.lockstep import ROMEO
from bench.rigs.reaching import RAMPING, Reaching
from bench.study.masses import MassesFound, MassesJob, examine
from bench.study.monte_carlo import spread
from daemon.config.load import load_robot

TOGETHER = 5
ALLOWED = 1.2  # rms of r by identified masses over that by exact ones.
WITHIN = 1.5  # 95 % intervals, within which every load lies.
_95 = 1.96
OTHERS = (
    Reaching(way="steps"),
    Reaching(way="steps", bandwidth_Hz=40.0),
    Reaching(way="accelerates", bandwidth_Hz=40.0, acceleration=60.0),
)
"""Drives that do not ramp from setpoint to setpoint."""


def joined(parts: list[MassesFound]) -> MassesFound:
    """Results of all arms, in an order that does not depend on who was faster."""
    parts = sorted(parts, key=lambda part: part.job.seed)
    return MassesFound(
        parts[0].job,
        np.concatenate([part.by_urdf for part in parts]),
        np.concatenate([part.by_identified for part in parts]),
        np.concatenate([part.loads for part in parts]),
        [reason for part in parts for reason in part.refused],
    )


def targets(found: MassesFound, others: MassesFound) -> list[Target]:
    """Targets of the project; others: by drives that do not ramp."""
    mass, weighed, apart, _, _ = found.loads.T
    return [
        *_of_masses(found, ""),
        Target("mass of a load, 95 % of arms",
               float(np.nanpercentile(100.0 * np.abs(weighed / mass - 1.0), 95.0)), 5, "%"),
        Target("centre of a load, 95 % of arms",
               float(np.nanpercentile(1e3 * apart, 95.0)), 10, "mm"),
        *_of_masses(others, ", by drives that do not ramp"),
    ]  # fmt: skip


def _of_masses(found: MassesFound, by: str) -> list[Target]:
    mass, weighed, apart, mass_error, com_error = found.loads.T
    off = np.stack([np.abs(weighed - mass) / mass_error, apart / com_error]) / _95
    return [
        Target(f"rms of |r| over that by exact masses, held out, worst joint of the worst arm{by}",
               float(np.nanmax(found.by_identified)), ALLOWED),
        Target(f"arms whose masses are refused{by}",
               100.0 * float(np.isnan(found.by_identified).any(axis=1).mean()), 5, "%"),
        Target(f"worst error of a load over its stated interval{by}", float(np.nanmax(off)),
               WITHIN),
        Target(f"loads that are refused{by}", 100.0 * float(np.isnan(weighed).mean()), 5, "%"),
    ]  # fmt: skip


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=10)
@click.option("--seconds", default=60.0)
@JOBS
@SEED
def main(arms: int, seconds: float, processes: int, seed: int, as_json: bool) -> None:
    todo = [
        MassesJob(min(TOGETHER, arms - first), seconds, (seed, first), reaching)
        for reaching in (RAMPING, *OTHERS)
        for first in range(0, arms, TOGETHER)
    ]
    count = arms * (1 + len(OTHERS))
    parts = list(spread(examine, todo, processes, f"{count} arms"))
    found = joined([part for part in parts if part.job.reaching == RAMPING])
    others = joined([part for part in parts if part.job.reaching != RAMPING])
    names = load_robot(ROMEO).configuration.joint_names
    data: dict[str, Any] = {
        "joints": names,
        "arms": arms,
        "by_urdf": summary(found.by_urdf),
        "by_identified": summary(found.by_identified),
        "by_identified_others": summary(others.by_identified),
        "refused": found.refused + others.refused,
        "loads_kg_m": found.loads.tolist(),
        "loads_others_kg_m": others.loads.tolist(),
    }
    print_report("masses", seed, targets(found, others), data, as_json=as_json)


if __name__ == "__main__":
    main()
