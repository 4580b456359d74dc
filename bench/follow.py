"""Streams of targets: delay, tracking, false stops, deaths, wild targets, and touches on the way.

    python -m bench.follow [--minutes N] [--arms N] [--hours H] [--jobs N] [--seed N] [--json]

Both arms of `configs/` follow sines and the reaches of a hand, sent at 20, 50, 100 and 200 Hz, with
10 ms of jitter and 5 % lost, for --minutes each. The error is that beside the constant delay that
fits best. "Beyond" is the delay of each moment in motion less the one that the stream reports.

A stream ends by itself when it is silent; false stops are counted in --hours of living senders at
each rate. Deaths, of Romeo arms of the world's width: silence, targets that come ever later,
repeated ones, a clock that stands or runs back, no numbers; the time from the last target that
could be relied on until each setpoint was zero, less the braking time. Wild targets
jump, lie outside all limits, or are no numbers; setpoints beyond a limit are counted on an arm
without lag.

--arms of the world's width, simulated without a bus, with what learning leaves on: touches of twice
the level in force, every five seconds in motion, on the stream and on the same motion as a
trajectory; false contacts of --minutes of a hand's motion each; the time of a tick with and without
a stream.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from bench.options import JOBS, SEED, help_of
from bench.report import Target, print_report
from bench.rigs.lockstep import DESK_ARM, ROMEO
from bench.study.monte_carlo import spread
from bench.study.stream_contacts import work
from bench.study.stream_deaths import DEATHS, death
from bench.study.stream_quality import Quality, beyond_limits, false_stops, quality
from bench.study.streamed import MOTIONS, RATES_HZ, arrivals, track
from daemon.config.load import load_robot
from daemon.config.vectors import limits_of
from programs.command_line.options import Range

ROBOTS: Final = (ROMEO, DESK_ARM)
WILD: Final = 500
"""streams of wild targets to each robot"""
DYING: Final = 20
"""streams that die in each way"""
TOUCH_RATE_HZ: Final = 50.0
TICK_S: Final = 0.01
"""of the arms that are touched"""
WAYS: Final = ("trajectory", "stream")


@dataclass(frozen=True, slots=True)
class Followed:
    """One motion at one rate."""

    robot: str
    motion: str
    rate_hz: float
    quality: Quality


@dataclass(frozen=True, slots=True)
class Job:
    """One piece of work, done by a process of its own."""

    kind: str
    robot: Path
    seed: int
    seconds: float
    rate_hz: float = 0.0
    what: str = ""


def run(job: Job) -> tuple[Job, Any]:
    """Result of a job."""
    robot = load_robot(job.robot)
    match job.kind:
        case "quality":
            return job, _followed(job)
        case "stops":
            return job, false_stops(robot, job.rate_hz, job.seconds / 3600.0, job.seed)
        case "death":
            return job, death(robot, job.what, job.rate_hz, job.seed)
        case "wild":
            return job, beyond_limits(robot, job.seed)
        case _:
            touched, streamed = job.kind == "touches", job.what == "stream"
            seconds = job.seconds
            return job, work(
                robot, job.rate_hz, job.seed, seconds, streamed=streamed, touched=touched
            )


def _followed(job: Job) -> Followed:
    robot = load_robot(job.robot)
    limits, period_s = limits_of(robot.configuration), robot.configuration.period_s
    motion = MOTIONS[job.what](limits, job.seconds, job.seed)
    coming = arrivals(motion, job.rate_hz, job.seconds, job.seed)
    found = quality(track(robot, coming, job.seconds - 1.0), motion, period_s)
    return Followed(robot.configuration.name, job.what, job.rate_hz, found)


def jobs(minutes: float, arms: int, hours: float, seed: int) -> list[Job]:
    """All of it."""
    seconds = max(60.0 * minutes, 10.0)
    todo = [
        Job("quality", robot, seed, seconds, rate, motion)
        for robot in ROBOTS
        for motion in MOTIONS
        for rate in RATES_HZ
    ]
    todo += [Job("stops", ROMEO, seed, 3600.0 * hours, rate) for rate in RATES_HZ]
    todo += [
        Job("death", ROMEO, seed + k, 0.0, RATES_HZ[k % len(RATES_HZ)], way)
        for way in DEATHS
        for k in range(DYING)
    ]
    todo += [Job("wild", robot, seed + k, 0.0) for robot in ROBOTS for k in range(WILD)]
    for k in range(arms):
        for what in WAYS:
            todo.append(Job("touches", ROMEO, seed + k, seconds, TOUCH_RATE_HZ, what))
        todo.append(Job("false", ROMEO, seed + k, seconds, TOUCH_RATE_HZ, "stream"))
    return todo


def targets(done: Sequence[tuple[Job, Any]]) -> list[Target]:
    """Figures against their limits."""
    of = partial(_of, done)
    ours = [f.quality for f in of("quality")]
    stands_s = max(d.stands_s for d in of("death"))
    at_100 = [f.quality.reported_ms for f in of("quality") if f.rate_hz == 100.0]
    felt = {what: np.array([s for w in of("touches", what) for s in w.felt_s]) for what in WAYS}
    found = [
        Target("p50 beyond the delay, worst", max(q.beyond[0] for q in ours), 1.5, "ticks"),
        Target("p95 beyond the delay, worst", max(q.beyond[1] for q in ours), 3, "ticks"),
        Target("delay at 100 Hz", max(at_100), 60, "ms"),
        Target("false stops an hour, worst rate", max(s[0] for s in of("stops")), 1),
        Target("setpoints zero after a death, less braking", 1e3 * stands_s, 150, "ms"),
        Target("setpoints beyond a limit, wild targets", sum(of("wild")), 0),
        Target("false contacts", sum(w.false for w in of("false")), 0),
    ]
    for share in (50, 95):
        stream, trajectory = (percentile(felt[what], share) for what in ("stream", "trajectory"))
        ratio = stream / trajectory
        found.append(Target(f"touches, p{share} over that of a trajectory", ratio, 1.1, "x"))
    return found


def percentile(delays: np.ndarray, share: float) -> float:
    """Percentile of delays [s], NaN without any; a missed touch is as late as any. Delays are whole
    ticks; touches begin anywhere between two of them, so it is read within the tick."""
    if not len(delays):
        return math.nan
    ticks, wanted = np.round(np.sort(delays) / TICK_S), share / 100.0 * len(delays)
    tick = ticks[min(math.floor(wanted), len(ticks) - 1)]
    before, there = np.sum(ticks < tick), np.sum(ticks == tick)
    return float(TICK_S * (tick - 1.0 + (wanted - before) / there))


def _of(done: Sequence[tuple[Job, Any]], kind: str, what: str = "") -> list[Any]:
    """Results of jobs of a kind."""
    return [r for job, r in done if job.kind == kind and what in ("", job.what)]


def tick_ratio(done: Sequence[tuple[Job, Any]]) -> float:
    """p99 of a tick's time with a stream over that with a trajectory, of the same arms."""
    trajectory, stream = (
        np.percentile([s for w in _of(done, "touches", what) for s in w.tick_s], 99)
        for what in WAYS
    )
    return float(stream / trajectory)


def in_words(done: Sequence[tuple[Job, Any]]) -> dict[str, Any]:
    """Other figures."""
    stops = {job.rate_hz: r for job, r in done if job.kind == "stops"}
    felt: dict[str, Any] = {}
    for what in WAYS:
        delays = np.array([s for w in _of(done, "touches", what) for s in w.felt_s])
        felt[what] = {
            "touches": len(delays),
            "missed": int(np.isinf(delays).sum()),
            "p50_ms": round(1e3 * percentile(delays, 50)),
            "p95_ms": round(1e3 * percentile(delays, 95)),
        }
    held = [d.held_rad for d in _of(done, "death")]
    return {
        "held_after_a_death_rad": {"p50": float(np.median(held)), "worst": max(held)},
        "stalls": {f"{rate:.0f} Hz": count for rate, (_, count) in stops.items()},
        "felt": felt,
        "tick_p99_ratio": tick_ratio(done),
    }


@click.command(help=help_of(__doc__))
@click.option("--minutes", type=Range(0.1, 600), default=3.0, show_default=True)
@click.option("--arms", type=click.IntRange(min=1), default=20, show_default=True)
@click.option("--hours", type=Range(0.01, 24), default=1.0, show_default=True)
@JOBS
@SEED
@click.option("--json", "as_json", is_flag=True)
def main(minutes: float, arms: int, hours: float, processes: int, seed: int, as_json: bool) -> None:
    todo = jobs(minutes, arms, hours, seed)
    done = sorted(spread(run, todo, processes, "pieces"), key=lambda one: todo.index(one[0]))
    followed = _of(done, "quality")
    figures = in_words(done)
    data = {"followed": [asdict(f) for f in followed], **figures}
    print_report("follow", seed, targets(done), data, as_json=as_json)


if __name__ == "__main__":
    main()
