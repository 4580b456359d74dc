"""False contacts of every residual, over a population of arms as wide as the world.

    python -m bench.false_contacts [--arms N] [--minutes N] [--jobs N] [--seed N]
                                   [--friction smooth|dahl|lugre|all]
                                   [--motor-position measured|integrated] [--no-learning]
                                   [--gears CONDITION] [--load-known X] [--unseen] [--json]

N arms for each law of friction, each at work for N minutes untouched: sinusoids,
moves from point to point with rests, creeping at 0.02 rad/s, one joint at a time to and fro, and
standing. Their friction is 40 % off and drifts by 20 % in ten minutes, with a rise near rest of up
to 30 % (lugre); pre-sliding is 0.1 to 2 mrad, gears have 300 to 4000 Nm/rad, some drives step.
What the model does not know otherwise, as `bench.detection` has it. --gears adds what gears do that
the estimator does not model (`bench.study.world`); --unseen three changes of the plant, one after
the other, drawn by the seed (`bench.study.unseen`).

Simulated without a bus. A false contact begins where the residual exceeds the threshold in force;
"gap under load" counts ticks in which a joint is called to be in its gap while its gear carries
more than half the contact level.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, Final, Literal

import click
import numpy as np
from numpy.typing import NDArray

from bench.options import FIRST_SEED, FRICTION, GEAR, JOBS, command
from bench.report import Target, print_report
from bench.rigs.arm_without_bus import Recording, Scenario, recordings
from bench.rigs.lockstep import ROMEO
from bench.study import courses, unseen, world
from bench.study.estimates import Estimates, build, estimates
from bench.study.monte_carlo import GRACE_S, spread
from bench.study.scores import count_alarms
from bench.study.world import Gears, Law
from common.arrays import Matrix
from daemon.config.load import load_robot
from estimator.motor_position import Side
from programs.command_line.options import Range

PARTS: Final = tuple(courses.PARTS)
FAST: Final = 0.05  # [rad/s]; from here on a motor counts as moving


@dataclass(frozen=True, slots=True)
class Job:
    """One arm."""

    robot: Path
    law: Law
    seed: int
    seconds: float
    changes: Mapping[str, Any]  # of the configured EstimatorSettings
    gears: Gears = "modelled"
    load_known: float | None = None  # to so much, of friction per transmitted torque
    unseen: str = ""  # change of its physics, of `bench.study.unseen`


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Counts of one arm, or of several added up."""

    hours: float
    alarms: NDArray[np.int64]  # (variants, PARTS, n)
    gap_under_load: NDArray[np.int64]  # ticks (n,)
    thresholds: Matrix  # (n, arms): median in motion, over the configured level

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(
            hours=self.hours + other.hours,
            alarms=self.alarms + other.alarms,
            gap_under_load=self.gap_under_load + other.gap_under_load,
            thresholds=np.hstack((self.thresholds, other.thresholds)),
        )


def run(job: Job) -> tuple[Job, tuple[str, ...], Tally]:
    """Simulate and judge one arm; the names are those of the residuals."""
    robot = load_robot(job.robot)
    if job.load_known is not None:
        robot = world.load_known(robot, world.gear_settings(job.gears, job.seed), job.load_known)
    c = robot.configuration
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    course, kinds = courses.day(c, job.seed, job.seconds)
    estimator = build(robot, **job.changes)
    change = unseen.CHANGES.get(job.unseen)
    act = change and change(np.random.default_rng((job.seed, 91)), contact)
    scenario = Scenario(seconds=job.seconds, motion=course, act=act)
    begun, parts, raised = 0, [], []
    names: tuple[str, ...] = ()
    for recording in recordings(world.subject(robot, job.law, job.seed, job.gears), scenario):
        found = estimates(estimator, recording)
        names, end = tuple(found.residuals), begun + len(recording.time_s)
        parts.append(tally(recording, found, kinds[begun:end], contact))
        moving = np.abs(recording.samples[:, 2]) > FAST
        raised.append(np.where(moving, found.threshold / contact, np.nan))
        begun = end
    medians = np.nanmedian(np.concatenate(raised), axis=0)[:, np.newaxis]
    whole = reduce(add, parts)
    return job, names, replace(whole, thresholds=medians)


def tally(
    recording: Recording, found: Estimates, kinds: NDArray[np.int64], contact: Matrix
) -> Tally:
    """Counts of a stretch; alarms count from GRACE_S of the day on."""
    armed = recording.time_s > GRACE_S
    chosen = [(armed & (kinds == part))[:, np.newaxis] for part in range(len(PARTS))]
    alarms = np.array(
        [
            [count_alarms(np.where(part, r, 0.0), found.threshold) for part in chosen]
            for r in found.residuals.values()
        ]
    )
    load = np.abs(recording.at(found.delay_s, recording.gear_torque))
    false_gap = (found.side == Side.GAP) & (load > 0.5 * contact)
    return Tally(
        hours=len(recording.time_s) * recording.per_tick / 3.6e6,
        alarms=alarms,
        gap_under_load=np.count_nonzero(false_gap, axis=0),
        thresholds=np.empty((len(contact), 0)),
    )


def targets(found: dict[Law, Tally], deciding: str) -> list[Target]:
    """Targets of the residual that decides."""
    return [
        Target(f"false contacts in {one.hours:.3g} h, {deciding}, {law}", one.alarms[0].sum(), 0)
        for law, one in found.items()
    ]


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=2)
@click.option("--minutes", type=click.FloatRange(0.1, 600.0), default=12.0)
@JOBS
@FIRST_SEED
@FRICTION
@click.option(
    "--motor-position", default="integrated", type=click.Choice(["measured", "integrated"])
)
@click.option("--learning/--no-learning", default=True, help="Of friction and levels.")
@GEAR
@click.option("--unseen", "changed", is_flag=True, help="Three changes drawn by the seed.")
@click.option("--load-known", type=Range(0, 0.1), help="How far `friction.load` may be off.")
def main(
    arms: int,
    minutes: float,
    processes: int,
    seed: int,
    laws: Sequence[Law],
    motor_position: Literal["measured", "integrated"],
    learning: bool,
    gears: Gears,
    load_known: float | None,
    changed: bool,
    as_json: bool,
) -> None:
    changes = {"motor_position": motor_position, "learning": learning}
    todo = [
        Job(ROMEO, law, arm, 60.0 * minutes, changes, gears, load_known, change)
        for change in (unseen.drawn(seed) if changed else [""])
        for arm in range(seed, seed + arms)
        for law in laws
    ]
    done = sorted(spread(run, todo, processes, "arms"), key=lambda one: one[0].seed)
    names = done[0][1]
    found = {law: reduce(add, [whole for job, _, whole in done if job.law == law]) for law in laws}
    data: dict[str, Any] = {
        "arms": arms,
        "minutes": minutes,
        "learning": learning,
        "gears": gears,
        "load_known": load_known,
        "motor_position": motor_position,
        "residuals": names,
        "parts": PARTS,
        "laws": {
            law: {
                "hours": whole.hours,
                "alarms": whole.alarms,
                "gap_under_load": whole.gap_under_load,
                "threshold_in_motion": np.median(whole.thresholds, axis=1).round(3),
            }
            for law, whole in found.items()
        },
        "by_arm": {
            f"{job.law} {job.seed} {job.unseen}".strip(): whole.alarms[0].sum(axis=0)
            for job, _, whole in done
        },
    }
    required = targets(found, names[0])
    if changed:
        required = [
            Target(f"false contacts an hour, {change}", one.alarms[0].sum() / one.hours, 2.0)
            for change, one in _by_change(done).items()
        ]
    print_report("false_contacts", seed, required, data, as_json=as_json)


def _by_change(done: Sequence[tuple[Job, tuple[str, ...], Tally]]) -> dict[str, Tally]:
    names = sorted({job.unseen for job, _, _ in done})
    return {name: reduce(add, [t for job, _, t in done if job.unseen == name]) for name in names}


if __name__ == "__main__":
    main()
