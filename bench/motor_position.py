"""Error of the rotor's place in its gap: integrated theta against exact theta, without contact.

    python -m bench.motor_position [--minutes N] [--arm-minutes N] [--jobs N] [--seed N]
                                   [--friction smooth|dahl|lugre|all] [--json]

N simulated minutes per kind of friction, over arms as wide as the world (those of
`bench.false_contacts`), whose motor velocity is off by 0.2 % and 1 mrad/s (0.02 % of a full scale
of 5 rad/s) and whose link encoder is 1 ms late. Every arm is switched on with its rotors anywhere
in their gaps and at once observed; other joints move in each, every other arm slowly, and all stand
still now and then. Two estimators see the same samples: one integrates the motor velocity, one is
given the motor position, exact but for an encoder's count. What they make of it is compared with
each other and with the plant.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, Final, Literal

import click
import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from arrays import Vector
from bench.options import JOBS, SEED, help_of
from bench.report import Target, print_report
from bench.rigs.arm_without_bus import Recording, Scenario, recordings
from bench.rigs.lockstep import ROMEO
from bench.study import population, world
from bench.study.estimates import Estimates, build, estimates
from bench.study.monte_carlo import spread
from bench.study.world import LAWS, Law
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from estimator.alarms import count_alarms
from estimator.motor_position import Side

SKEW_MS: Final = 1.0
SLOW: Final = 0.15
WIDE: Final = 0.010
"""Half-gap [rad] from which on the gap must be recognised."""
EVERY: Final = 10
"""Of so many errors of phi one is kept."""


@dataclass(frozen=True, slots=True)
class Job:
    """One arm."""

    robot: Path
    friction: Law
    seed: int
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Counts and extremes per joint (n,); tallies add up over time and arms."""

    samples: NDArray[np.int64]
    largest_integrated: Vector
    """|r| [Nm]"""
    largest_exact: Vector
    largest_drift: Vector
    """|trend| of the error of phi over an arm's whole time [rad/s]; 0 until it is over"""
    in_gap: NDArray[np.int64]
    """truly"""
    recognised: NDArray[np.int64]
    """in the gap, and said to be"""
    called_gap: NDArray[np.int64]
    false_gap: NDArray[np.int64]
    """said to be in the gap while the gear carries more than half the threshold"""
    alarms: NDArray[np.int64]
    """of the residual with integrated theta: false, as the motion is without contact"""
    unknown: NDArray[np.int64]
    overconfident: NDArray[np.int64]
    """error of phi beyond three times its stated uncertainty"""
    errors: NDArray[np.float64]
    """of phi [rad], (some samples, n)"""

    def __add__(self, other: "Tally") -> "Tally":
        merged: dict[str, Any] = {}
        for field in fields(self):
            a, b = getattr(self, field.name), getattr(other, field.name)
            if field.name.startswith("largest"):
                merged[field.name] = np.maximum(a, b)
            else:
                merged[field.name] = np.concatenate((a, b)) if field.name == "errors" else a + b
        return Tally(**merged)


def tally(recording: Recording, integrated: Estimates, exact: Estimates, contact: Vector) -> Tally:
    """Compare a stretch with the plant; contact: thresholds (n,) [Nm]."""
    delay_s = integrated.delay_s
    phi = recording.at(delay_s, recording.phi)
    load = np.abs(recording.at(delay_s, recording.gear_torque))
    in_gap = recording.at(delay_s, recording.apart)
    said_gap = integrated.side == Side.GAP
    error = integrated.phi - phi
    residual, reference = (next(iter(e.residuals.values())) for e in (integrated, exact))

    def count(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        return np.asarray(np.count_nonzero(chosen, axis=0))

    return Tally(
        samples=count(np.ones_like(in_gap)),
        largest_integrated=np.abs(residual).max(axis=0),
        largest_exact=np.abs(reference).max(axis=0),
        largest_drift=np.zeros(len(contact)),
        in_gap=count(in_gap),
        recognised=count(in_gap & said_gap),
        called_gap=count(said_gap),
        false_gap=count(said_gap & (load > 0.5 * contact)),
        alarms=count_alarms(residual, integrated.threshold),
        unknown=count(integrated.side == Side.UNKNOWN),
        overconfident=count(np.abs(error) > 3.0 * integrated.phi_sigma),
        errors=error[::EVERY],
    )


def run(job: Job) -> tuple[Law, Tally]:
    """Simulate one arm, and estimate twice."""
    robot = load_robot(job.robot)
    c = robot.configuration
    rng = np.random.default_rng((job.seed, 20))
    drawn = world.subject(robot, job.friction, job.seed)
    late = msgspec.structs.replace(drawn.settings, link_latency_ms=SKEW_MS)
    subject = replace(drawn, settings=late)
    slow = SLOW if job.seed % 2 else 1.0
    path = population.motion(c, job.seed, go_s=40.0, rest_s=10.0, slow=slow, held=0.35)
    alpha = np.array([joint.half_gap for joint in c.joints])
    scenario = Scenario(
        seconds=job.seconds, motion=path, phi=0.9 * rng.uniform(-alpha, alpha), settling_s=0.0
    )
    integrated = build(robot, beside=(), motor_position="integrated")
    exact = build(robot, beside=(), motor_position="measured")
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    whole = reduce(
        add,
        (
            tally(stretch, estimates(integrated, stretch), estimates(exact, stretch), contact)
            for stretch in recordings(subject, scenario)
        ),
    )
    return job.friction, replace(whole, largest_drift=np.abs(trend(whole.errors, c.period_s)))


def trend(errors: NDArray[np.float64], period_s: float) -> Vector:
    """Slope of a line through the errors of one arm (samples, n) [rad/s]."""
    time_s = EVERY * period_s * np.arange(len(errors))
    slope: Vector = np.polyfit(time_s, errors, 1)[0]
    return slope


def ratio(t: Tally, contact: Vector) -> Vector:
    """Largest |r| with integrated theta over that with exact theta; 1 where it is below 0.3 of the
    threshold (n,), which is small enough whatever the other one is."""
    small = t.largest_integrated <= 0.3 * contact
    quotient: Vector = np.where(small, 1.0, t.largest_integrated / t.largest_exact)
    return quotient


def recall(t: Tally, alpha: Vector) -> float:
    """Share of the samples truly in the gap that were recognised, over the joints that are wide."""
    wide = alpha >= WIDE
    return float(t.recognised[wide].sum() / max(t.in_gap[wide].sum(), 1))


def targets(arms: Mapping[Law, Sequence[Tally]], c: Configuration) -> list[Target]:
    """Targets of the project, over all arms, and the first of them on the worst arm alone."""
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    alpha = np.array([joint.half_gap for joint in c.joints])
    rows = []
    for f, of_arms in arms.items():
        t = reduce(add, of_arms)
        false_percent = 100.0 * float(np.max(t.false_gap / t.samples))
        rows += [
            Target(
                f"largest |r|, integrated over exact theta, {f}",
                float(np.max(ratio(t, contact))),
                1.15,
                "x",
                "lower",
            ),
            Target(
                f"the same of the worst arm alone, {f}",
                float(np.max([ratio(arm, contact) for arm in of_arms])),
                1.15,
                "x",
                "lower",
            ),
            Target(f"false alarms, integrated, {f}", int(t.alarms.sum()), 0, "", "lower"),
            Target(f"gap recognised, {f}", 100.0 * recall(t, alpha), 40, "%", "higher"),
            Target(f"called gap under load, worst joint, {f}", false_percent, 0.01, "%", "lower"),
        ]
    return rows


def rows_of(t: Tally, c: Configuration) -> dict[str, list[float]]:
    """Figures per joint that are shown; zero where a joint without a gap has none."""
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    has_gap = np.array([joint.half_gap > 0.0 for joint in c.joints])
    size, percent = np.abs(t.errors), 100.0 / t.samples
    values = {
        "max |r|, integrated [Nm]": t.largest_integrated,
        "max |r|, exact [Nm]": t.largest_exact,
        "their ratio (1: small)": ratio(t, contact),
        "false alarms": t.alarms,
        "in the gap [%]": percent * t.in_gap,
        "of it recognised [%]": 100.0 * t.recognised / np.maximum(t.in_gap, 1),
        "called gap [%]": percent * t.called_gap,
        "called so under load [%]": percent * t.false_gap,
        "side unknown [%]": percent * t.unknown * has_gap,
        "phi off, p50 [mrad]": 1000.0 * np.percentile(size, 50, axis=0),
        "phi off, p99 [mrad]": 1000.0 * np.percentile(size, 99, axis=0),
        "beyond 3 sigma [%]": percent * t.overconfident * has_gap,
        "drift of phi [mrad/min]": 60_000.0 * t.largest_drift,
    }
    return {name: [round(float(x), 4) for x in row] for name, row in values.items()}


def table(title: str, rows: dict[str, list[float]]) -> Table:
    """Table for people."""
    shown = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    shown.add_column("joint", no_wrap=True)
    n = len(next(iter(rows.values())))
    for i in range(n):
        shown.add_column(str(i + 1), justify="right", no_wrap=True)
    for name, row in rows.items():
        shown.add_row(escape(name), *(f"{x:.2f}" if abs(x) < 10.0 else f"{x:.1f}" for x in row))
    return shown


@click.command(help=help_of(__doc__))
@click.option("--minutes", default=10.0, show_default=True, help="Per kind of friction.")
@click.option("--arm-minutes", default=2.0, show_default=True, help="Of one arm, in one piece.")
@JOBS
@SEED
@click.option("--friction", default="all", type=click.Choice([*LAWS, "all"]))
@click.option("--json", "as_json", is_flag=True)
def main(
    minutes: float,
    arm_minutes: float,
    processes: int,
    seed: int,
    friction: Law | Literal["all"],
    as_json: bool,
) -> None:
    frictions: Sequence[Law] = LAWS if friction == "all" else (friction,)
    c = load_robot(ROMEO).configuration
    arm_minutes = min(arm_minutes, minutes)
    seeds = [1000 * seed + arm for arm in range(max(1, round(minutes / arm_minutes)))]
    todo = [Job(ROMEO, f, s, 60.0 * arm_minutes) for s in seeds for f in frictions]
    results = list(spread(run, todo, processes, "arms"))
    arms = {f: [t for of, t in results if of == f] for f in frictions}
    rows = {f: rows_of(reduce(add, of_arms), c) for f, of_arms in arms.items()}
    if not as_json:
        for f in frictions:
            title = (
                f"{f} friction: {len(seeds)} arms (seeds {seeds[0]} to {seeds[-1]}) "
                f"of {arm_minutes:g} minutes"
            )
            Console().print(table(title, rows[f]))
    data = {
        "arm_minutes": arm_minutes,
        "seeds": [seeds[0], seeds[-1]],
        "joints": c.joint_names,
        "per_joint": rows,
    }
    print_report("motor_position", seed, targets(arms, c), data, as_json=as_json)


if __name__ == "__main__":
    main()
