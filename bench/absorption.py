"""Share of a hand's torque that learning takes for friction, over arms as wide as the world.

    python -m bench.absorption [--arms N] [--minutes N] [--jobs N] [--seed N]
                               [--friction smooth|dahl|lugre|all] [--json]

Every arm works for four minutes; then a hand leans on all joints at once for N minutes while it
works on, with a share of the threshold in force in motion: 0.25, 0.5, 0.7 or 0.9. What is taken off
the residual meanwhile, less what is taken off where no hand is, was absorbed. Afterwards each joint
gets a step of twice the threshold then in force, which must be felt if it moves. In another run the
hand's torque grows by 0.1 threshold a second, until it is felt.

Arms are those of `bench.false_contacts`, but their friction does not drift: learning that follows
it, and rests while a hand is there, would count as absorbed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.options import FIRST_SEED, FRICTION, JOBS, command
from bench.report import Target, joints_table, plain, print_report
from bench.rigs.arm_without_bus import Push, Recording, Scenario, record
from bench.rigs.lockstep import ROMEO
from bench.study import courses, world
from bench.study.estimates import Estimates, build, estimates
from bench.study.monte_carlo import spread
from bench.study.world import Law
from common.arrays import Matrix, Vector
from daemon.config.load import load_robot

SHARES: Final = (0.25, 0.5, 0.7, 0.9)  # of the threshold in force
WORK_S: Final = 240.0
JUDGED_S: Final = 60.0  # at the end of the hand's time
STEP_S, STEP_EVERY_S, REST_S = 0.5, 2.0, 4.0
RAMP: Final = 0.1  # thresholds a second ...
RAMP_S: Final = 30.0  # ... for so long
MOVING: Final = 0.1  # [rad/s]


@dataclass(frozen=True, slots=True)
class Job:
    """One arm."""

    robot: Path
    law: Law
    seed: int
    hand_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What one arm did; NaN where a joint did not move enough to tell."""

    job: Job
    absorbed: Matrix  # (SHARES, n), of the hand's torque
    raised: Matrix  # (SHARES, n): threshold in force at the end over that before
    missed: NDArray[np.bool_]  # (SHARES, n): steps of twice the threshold afterwards
    ramp: Vector  # (n,): most of the growing hand that was not felt yet, over the threshold


class Arm:
    """One arm of the population, at the same work whatever the hand does."""

    def __init__(self, job: Job) -> None:
        self.robot = load_robot(job.robot)
        self.c = self.robot.configuration
        self.subject = replace(world.subject(self.robot, job.law, job.seed), drift=0.0)
        self.seed = job.seed

    def works(self, seconds: float, pushes: Sequence[Push] = ()) -> Recording:
        """A recording of its work."""
        course, _ = courses.day(self.c, self.seed, seconds)
        return record(self.subject, Scenario(seconds=seconds, motion=course, pushes=tuple(pushes)))

    def estimated(self, recording: Recording, *, learning: bool = True) -> Estimates:
        """The residual that decides, with an integrated theta."""
        how = {"beside": (), "motor_position": "integrated", "learning": learning}
        return estimates(build(self.robot, **how), recording)

    def taken_off(self, recording: Recording, found: Estimates) -> Matrix:
        """What learning took off the residual (ticks, n) [Nm]."""
        without = self.estimated(recording, learning=False)
        return next(iter(without.residuals.values())) - next(iter(found.residuals.values()))


def in_motion(recording: Recording, values: Matrix, part: slice) -> Vector:
    """Median of values (ticks, n) in motion in a part; NaN below three seconds of that."""
    moving = np.abs(recording.samples[part, 2]) > MOVING
    enough = np.count_nonzero(moving, axis=0) > 300
    chosen = np.where(moving, values[part], np.nan)
    chosen[:, ~enough] = 0.0
    medians: Vector = np.nanmedian(chosen, axis=0)
    medians[~enough] = np.nan
    return medians


def run(job: Job) -> Result:
    """Simulate and judge one arm."""
    arm = Arm(job)
    n, period_s = len(arm.c.joints), arm.c.period_s
    signs = np.random.default_rng((job.seed, 40)).choice((-1.0, 1.0), n)
    begin, end = round(WORK_S / period_s), round((WORK_S + job.hand_s) / period_s)
    judged = slice(end - round(JUDGED_S / period_s), end)
    alone = arm.works(WORK_S + job.hand_s)
    found = arm.estimated(alone)
    configured = np.array([joint.thresholds.contact for joint in arm.c.joints])
    level = in_motion(alone, found.threshold, slice(begin - judged.stop + judged.start, begin))
    level = np.where(np.isfinite(level), level, configured)
    usual = arm.taken_off(alone, found)
    absorbed, raised, missed = [], [], []
    for share in SHARES:
        hand = Push(round(1000 * WORK_S), round(1000 * job.hand_s), share * signs * level)
        led = arm.works(WORK_S + job.hand_s, [hand])
        found = arm.estimated(led)
        more = signs * (arm.taken_off(led, found) - usual)
        absorbed.append(in_motion(led, more, judged) / (share * level))
        after = in_motion(led, found.threshold, judged)
        raised.append(after / level)
        steps = afterwards(job, np.where(np.isfinite(after), after, level), signs)
        missed.append(~felt(arm, [hand, *steps], steps, signs))
    return Result(
        job=job,
        absorbed=np.array(absorbed),
        raised=np.array(raised),
        missed=np.array(missed),
        ramp=ramp(arm, level, signs),
    )


def afterwards(job: Job, level: Vector, signs: Vector) -> list[Push]:
    """A step of twice the level (n,) [Nm] on each joint, one after the other."""
    first_s = WORK_S + job.hand_s + REST_S
    return [
        Push(
            round(1000 * (first_s + STEP_EVERY_S * i)),
            round(1000 * STEP_S),
            2.0 * level[i] * signs * (np.arange(len(level)) == i),
        )
        for i in range(len(level))
    ]


def felt(
    arm: Arm, pushes: Sequence[Push], steps: Sequence[Push], signs: Vector
) -> NDArray[np.bool_]:
    """Joints (n,) that felt their step, or were at rest and are not asked."""
    last = steps[-1]
    recording = arm.works(1e-3 * (last.onset_ms + last.duration_ms) + 0.5, pushes)
    found = arm.estimated(recording)
    residual = next(iter(found.residuals.values()))
    shown = []
    for i, step in enumerate(steps):
        first = step.onset_ms // recording.per_tick
        ticks = slice(first, first + step.duration_ms // recording.per_tick + 5)
        beyond = signs[i] * residual[ticks, i] > found.threshold[ticks, i]
        moves = np.abs(recording.samples[ticks, 2, i]).min() > MOVING
        shown.append(bool(beyond.any() or not moves))
    return np.array(shown)


def ramp(arm: Arm, level: Vector, signs: Vector) -> Vector:
    """Largest torque of a growing hand, over the threshold in force, that was not felt yet in
    motion (n,); NaN where a joint did not move before it felt the hand."""
    onset, steps = round(1000 * WORK_S), round(10 * RAMP_S)
    pushes = [
        Push(onset + 100 * k, 100 * (steps - k), 0.1 * RAMP * signs * level) for k in range(steps)
    ]
    recording = arm.works(WORK_S + RAMP_S, pushes)
    found = arm.estimated(recording)
    residual = next(iter(found.residuals.values()))
    begin = onset // recording.per_tick
    threshold, moving = found.threshold[begin:], np.abs(recording.samples[begin:, 2]) > MOVING
    torque = np.abs(recording.at(found.delay_s, recording.external)[begin:])
    beyond = signs * residual[begin:] > threshold
    before = np.cumsum(beyond, axis=0) == 0
    unfelt: Vector = np.max(np.where(moving & before, torque / threshold, -1.0), axis=0)
    return np.where(unfelt >= 0.0, unfelt, np.nan)


def targets(results: Sequence[Result]) -> list[Target]:
    """What learning may cost."""
    rows = []
    for k, share in enumerate(SHARES):
        absorbed = np.array([r.absorbed[k] for r in results])
        if share >= 0.5:
            worst = 100.0 * float(np.nanmax(absorbed))
            name = f"absorbed of {share:g} thresholds, worst joint of all arms"
            rows.append(Target(name, worst, 5.0, "%"))
        missed = int(np.sum([r.missed[k] for r in results]))
        name = f"steps of twice the threshold missed after {share:g} thresholds"
        rows.append(Target(name, missed, 0))
    ratios = np.array([r.ramp for r in results])
    name = "growing hand not felt yet, of the threshold, worst"
    rows.append(Target(name, float(np.nanmax(ratios)), 1.2, "x"))
    return rows


def table(results: Sequence[Result], n: int) -> Table:
    """Joint by joint: median and largest over the arms."""
    shown = joints_table("of the hand's torque absorbed [%]", n, "hand, of the threshold")
    for k, share in enumerate(SHARES):
        absorbed = 100.0 * np.array([r.absorbed[k] for r in results])
        raised = np.array([r.raised[k] for r in results])
        shown.add_row(f"{share:g}: median", *_over_arms(absorbed, np.median, "{:.0f}"))
        shown.add_row("     largest", *_over_arms(absorbed, np.max, "{:.0f}"))
        shown.add_row("     threshold grew", *_over_arms(raised, np.median, "{:.1f}x"))
    return shown


def _over_arms(values: Matrix, of: Callable[[Matrix], Any], words: str) -> list[str]:
    """What the arms (arms, n) come to, joint by joint; `-` where none moved enough to tell."""
    told = [column[np.isfinite(column)] for column in values.T]
    return [words.format(of(column)) if column.size else "-" for column in told]


@command(__doc__)
@click.option("--arms", type=click.IntRange(min=1), default=2)
@click.option("--minutes", type=click.FloatRange(1.5, 60.0), default=10.0)
@JOBS
@FIRST_SEED
@FRICTION
def main(
    arms: int, minutes: float, processes: int, seed: int, laws: Sequence[Law], as_json: bool
) -> None:
    todo = [
        Job(ROMEO, law, arm, 60.0 * minutes) for arm in range(seed, seed + arms) for law in laws
    ]
    results = sorted(spread(run, todo, processes, "arms"), key=lambda r: (r.job.seed, r.job.law))
    if not as_json:
        Console().print(table(results, results[0].ramp.size))
    data: dict[str, Any] = {
        "arms": arms,
        "minutes": minutes,
        "shares": SHARES,
        "by_arm": {
            f"{r.job.law} {r.job.seed}": {
                "absorbed": r.absorbed,
                "threshold_grew": r.raised,
                "missed": r.missed,
                "ramp": r.ramp,
            }
            for r in results
        },
    }
    print_report("absorption", seed, targets(results), plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
