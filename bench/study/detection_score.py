"""Score of one residual, from the runs of many arms."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from bench.study import scores
from bench.study.monte_carlo import Result
from bench.study.scores import Detection, Trial
from common.arrays import Vector
from daemon.assembly import build_transmission
from daemon.config.schema import Configuration
from estimator.alarms import per_hour


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Score of one residual under one friction law; lists are per joint, NaN without a trial."""

    hours: float  # contact-free
    alarms: int
    alarms_per_hour: float
    quiet_nm: list[float]  # lowest thresholds without an alarm
    smallest_moving_nm: list[float]
    """smallest step detected in every trial with continuous motion of the joint: by the residual
    that decides at its levels in force, by the rivals at those thresholds"""
    smallest_turning_nm: list[float]  # the same where the joint stood or turned meanwhile
    smallest_rest_nm: list[float]
    hidden_rest_nm: list[float]  # largest part of it that gear friction hid from the motor
    stiction_rest_nm: list[float]  # the most that friction may hide, by reversing
    in_force_nm: list[float]  # threshold in motion after work, median over the arms
    missed_moving: int  # of the steps of two to four times the threshold in force at their onset
    tried_moving: int
    missed_rest: int  # the same
    tried_rest: int
    delay_ms: tuple[float, float]  # p50 and p95 in motion, of those steps, no gap to cross
    delay_travel_ms: tuple[float, float]  # the same where link and rotor came apart
    delay_rest_ms: tuple[float, float]
    rms_nm: list[float]  # error in motion while engaged, against the filtered true torque


def score(results: Sequence[Result], name: str, c: Configuration) -> Score:
    """Score of the residual `name` over all results of one friction law."""
    contact = np.array([joint.thresholds.contact for joint in c.joints])
    variant = results[0].names.index(name)
    free = [r for r in results if r.job.kind == "free"]
    moving = [t for r in results if r.job.kind == "moving" for t in r.trials]
    resting = [t for r in results if r.job.kind == "rest" for t in r.trials]
    going, turning = ([t for t in moving if t.moving is way] for way in (True, False))
    quiet = np.max([r.quiet[variant] for r in free], axis=0)
    used = contact if variant == 0 else quiet
    seconds = sum(r.job.seconds for r in free)
    count = sum(int(r.alarms[variant].sum()) for r in free)

    moved = detections(twice(moving, variant, contact), variant, contact)
    rested = detections(twice(resting, variant, contact), variant, contact)
    stuck = build_transmission(c).engaged_coulomb
    level = np.median([r.level for r in results], axis=0)
    errors = reduce(add, [r.errors[variant] for r in results if r.job.kind == "moving"])
    return Score(
        hours=seconds / 3600.0,
        alarms=count,
        alarms_per_hour=per_hour(count, seconds),
        quiet_nm=quiet.tolist(),
        smallest_moving_nm=smallest(going, variant, used, 2.0 * contact),
        smallest_turning_nm=smallest(turning, variant, used, 2.0 * contact),
        smallest_rest_nm=smallest(resting, variant, used, 2.0 * (contact + stuck)),
        stiction_rest_nm=stiction(resting, len(contact)),
        hidden_rest_nm=most(resting, len(contact), lambda t: t.hidden, 2.0 * (contact + stuck)),
        in_force_nm=level.tolist(),
        missed_moving=sum(f is None for f in moved),
        tried_moving=len(moved),
        missed_rest=sum(f is None for f in rested),
        tried_rest=len(rested),
        delay_ms=delays([f for f in moved if f and not f.travelled]),
        delay_travel_ms=delays([f for f in moved if f and f.travelled]),
        delay_rest_ms=delays([f for f in rested if f]),
        rms_nm=errors.rms.tolist(),
    )


def detections(trials: Sequence[Trial], variant: int, threshold: Vector) -> list[Detection | None]:
    """Detection of each step; without steps during an alarm in the same direction."""
    return [
        scores.detection(t, variant, float(threshold[t.joint]))
        for t in trials
        if t.before[variant] <= threshold[t.joint] + t.raised[variant, 0]
    ]


def twice(trials: Sequence[Trial], variant: int, threshold: Vector) -> list[Trial]:
    """Steps of two to four times the threshold in force at their onset."""
    return [t for t in trials if 2.0 <= t.size / (threshold[t.joint] + t.raised[variant, 0]) <= 4.0]


def most(
    trials: Sequence[Trial], joints: int, of: Callable[[Trial], float], up_to: Vector | None = None
) -> list[float]:
    """Largest figure of all trials per joint, NaN without any; `up_to`: of steps up to this
    size."""
    found: list[list[float]] = [[] for _ in range(joints)]
    for t in trials:
        if up_to is None or t.size <= up_to[t.joint] * (1.0 + 1e-9):
            found[t.joint].append(of(t))
    return [max(figures, default=math.nan) for figures in found]


def smallest(
    trials: Sequence[Trial], variant: int, threshold: Vector, largest: Vector
) -> list[float]:
    """Smallest step per joint [Nm] that every trial would have detected at these thresholds, from
    trials with steps up to `largest`, as a large step disturbs the arm more than a small one."""

    def needed(t: Trial) -> float:
        return scores.size_needed(t, variant, float(threshold[t.joint]))

    return most(trials, len(threshold), needed, largest)


def stiction(trials: Sequence[Trial], joints: int) -> list[float]:
    """Twice the breakaway torque per joint [Nm], the largest of all trials."""
    return most(trials, joints, lambda t: 2.0 * t.breakaway)


def delays(found: Sequence[Detection]) -> tuple[float, float]:
    """p50 and p95 [ms]."""
    values = [1000.0 * f.delay_s for f in found]
    return scores.percentile(values, 50), scores.percentile(values, 95)
