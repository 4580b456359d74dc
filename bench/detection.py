"""False alarms, smallest step, delay and error of every residual, over arms as wide as the world.

    python -m bench.detection [--minutes N] [--step-minutes N] [--jobs N] [--seed N]
                              [--friction smooth|dahl|lugre|all]
                              [--motor-position measured|integrated] [--gears CONDITION]
                              [--no-link-encoder] [--robot FOLDER] [--json]

Simulated minutes per kind of friction: --minutes without contact, --step-minutes with steps of
torque on single joints in motion, half as many with steps at rest. A new arm comes every minute, of
those of `bench.false_contacts`: masses 5 %, centres of mass 5 mm, friction 40 % and drifting by
20 %, K_c 3 %, alpha and B 10 %, link encoder up to 1 ms late, drives that filter and quantise, and
some that step; motor velocities are off by 0.2 % and 1 mrad/s. Each has been at work for ten
minutes before, which it learned from.
Simulated without a bus, with the samples that a bus would bring. The residual that decides has its
levels in force; rivals those of the configuration, raised as if nothing was learned, and their
smallest step is that at the lowest levels for which the contact-free minutes raise no alarm.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Literal

import click
import numpy as np

from bench.options import FRICTION, GEAR, JOBS, SEED, command
from bench.report import Target, plain, print_report
from bench.rigs.lockstep import ROMEO
from bench.study.detection_score import Score, score
from bench.study.monte_carlo import Job, Kind, Result, run, spread
from bench.study.world import Gears, Law
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from programs.command_line.options import Range

LENGTHS_S: Final[dict[Kind, float]] = {"free": 60.0, "moving": 60.0, "rest": 31.0}
MotorPosition = Literal["measured", "integrated"]


def jobs(
    minutes: float, step_minutes: float, seed: int, laws: Sequence[Law], robot: Path = ROMEO,
    **alike: Any,
) -> list[Job]:  # fmt: skip
    """A new arm every minute; the same seeds for either friction. alike: of all of them."""
    free, stepped = max(1, round(minutes)), max(1, round(step_minutes))
    return [
        Job(robot, kind, friction, 1000 * seed + arm, seconds, **alike)
        for arm in range(max(free, stepped))
        for friction in laws
        for kind, seconds in LENGTHS_S.items()
        if arm < (free if kind == "free" else stepped)
    ]


def worth(deciding: Score, classical: Score, gaps: Sequence[int]) -> float:
    """Ratio of the smallest steps that the classical residual and the one that decides detect in
    motion, on the joints with a gap; the least of them, NaN where one is unknown."""
    ratios = [classical.smallest_moving_nm[i] / deciding.smallest_moving_nm[i] for i in gaps]
    return float(np.min(ratios)) if ratios else math.nan  # NaN of a joint is NaN of all


def at_rest(deciding: Score, classical: Score, gaps: Sequence[int]) -> float:
    """Smallest step at rest over what stiction may hide there: the most over the joints with a gap
    on which the classical residual does not need three times as much. NaN where one is unknown."""
    ratios = [
        deciding.smallest_rest_nm[i] / deciding.stiction_rest_nm[i]
        for i in gaps
        if not classical.smallest_rest_nm[i] >= 3.0 * deciding.smallest_rest_nm[i]
    ]
    return float(np.max(ratios)) if ratios else 0.0


def alarmed(results: Sequence[Result], joints: Sequence[str]) -> list[str]:
    """Joints and arms that raised false alarms of the residual that decides, with their number."""
    return [
        f"{joint} of arm {result.job.seed} ({count})"
        for result in results
        if result.job.kind == "free"
        for joint, count in zip(joints, result.alarms[0].tolist(), strict=True)
        if count
    ]


def targets(found: Mapping[Law, dict[str, Score]], c: Configuration) -> list[Target]:
    """Targets of the project for the residual that decides."""
    deciding, limit = c.estimator.residual.name, 1000.0 * math.log(2.0) / c.estimator.gain
    gaps = [i for i, joint in enumerate(c.joints) if joint.half_gap > 0.0]
    contact = [joint.thresholds.contact for joint in c.joints]
    rows = []
    for friction, by_name in found.items():
        best = by_name[deciding]
        of = f"{deciding}, {friction}"
        moving_ms, rest_ms = np.subtract((best.delay_ms, best.delay_rest_ms), limit).tolist()
        step, step_at_rest = (
            of_two(best, by_name["classical"], gaps) for of_two in (worth, at_rest)
        )
        in_force = float(np.median(np.divide(best.in_force_nm, contact)))
        rows += [
            Target(f"false alarms in {best.hours:.3g} h, {of}", best.alarms, 0),
            Target(f"smallest step, classical over {of}", step, 6, "x", "higher"),
            Target(f"steps of twice the threshold missed, {of}", best.missed_moving, 0),
            Target(f"p50 delay beyond ln 2 / K, {of}", moving_ms[0], 12, "ms"),
            Target(f"p95 delay beyond ln 2 / K, {of}", moving_ms[1], 45, "ms"),
            Target(f"the same at rest missed, {of}", best.missed_rest, 0),
            Target(
                f"smallest step at rest, over what stiction may hide, {of}", step_at_rest, 1.25, "x"
            ),
            Target(f"p50 delay at rest beyond ln 2 / K, {of}", rest_ms[0], 15, "ms"),
            Target(f"p95 delay at rest beyond ln 2 / K, {of}", rest_ms[1], 100, "ms"),
            Target(f"threshold in force in motion, of the configured, {of}", in_force, 0.4, "x"),
        ]
    return rows


@command(__doc__)
@click.option("--minutes", type=Range(1, 600), default=10.0, help="Contact-free, per friction.")
@click.option("--step-minutes", type=Range(1, 600), show_default="as --minutes", help="With steps.")
@JOBS
@SEED
@FRICTION
@click.option("--motor-position", default="measured", type=click.Choice(["measured", "integrated"]))
@GEAR
@click.option("--robot", default=ROMEO, type=click.Path(path_type=Path), help="Its folder.")
@click.option("--no-link-encoder", "blind", is_flag=True, help="Motor encoders alone.")
def main(
    minutes: float,
    step_minutes: float | None,
    processes: int,
    seed: int,
    laws: Sequence[Law],
    motor_position: MotorPosition,
    gears: Gears,
    robot: Path,
    blind: bool,
    as_json: bool,
) -> None:
    c = load_robot(robot).configuration
    step_minutes = minutes if step_minutes is None else step_minutes
    alike = {"motor_position": motor_position, "gears": gears, "link_encoder": not blind}
    todo = jobs(minutes, step_minutes, seed, laws, robot, **alike)
    seeds = sorted({job.seed for job in todo if job.kind == "free"})
    stepped = len({job.seed for job in todo if job.kind == "moving"})
    results = list(spread(run, todo, processes, "arms"))
    results.sort(key=lambda result: (result.job.seed, result.job.kind))
    by_law = {f: [r for r in results if r.job.friction == f] for f in laws}
    found = {f: {n: score(rs, n, c) for n in rs[0].names} for f, rs in by_law.items()}
    alarms = {f: alarmed(rs, c.joint_names) for f, rs in by_law.items()}
    data = {
        "minutes": len(seeds),
        "step_minutes": stepped,
        "seeds": [seeds[0], seeds[-1]],
        "motor_position": motor_position,
        "gears": gears,
        "link_encoder": not blind,
        "ln2_over_K_ms": 1000 * math.log(2) / c.estimator.gain,
        "joints": c.joint_names,
        "alarms": alarms,
        "scores": {f: {n: asdict(s) for n, s in by_name.items()} for f, by_name in found.items()},
    }
    print_report("detection", seed, targets(found, c), plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
