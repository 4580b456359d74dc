"""Thresholds from contact-free motion, at a chosen rate of false alarms.

Joints that did not move get none. Stretches left out because they look like a touch are listed: if
no person was near the arm, the level has to cover them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.alarms import excess

BLOCK_S = 1.0
"""Length of a block; its largest |r| is one draw from an extreme-value distribution."""
FEWEST_BLOCKS = 30
FROZEN_AROUND_S = 0.5
"""Time around a touch that is excluded, too."""
LEAST_TRAVEL = 0.05
"""Least range of the link [rad], beyond its gap, for a level that is valid in motion."""
_GROSS = 5.0  # times the median block is a touch, however high the old threshold
_ALONE = 2.0  # times the rest, which 59 joints of untouched logs reached
_MOST_TOUCHED = 0.2
_MOSTLY = 0.5  # of the time
_WORTH = 0.1  # share of the mean threshold that growth with speed has to save
_SPEEDS = np.linspace(0.0, 1.0, 21)  # shares of the level at rest, added at the largest speed


class LevelVerdict(StrEnum):
    """Verdict on new levels: `good`, or the reason why the old ones are kept."""

    GOOD = "good"
    CEILING = "above the ceiling"
    TOUCHED = "touched too often"
    SHORT = "too little motion"
    STILL = "did not move"
    SWINGS = "swings by itself"
    UNLESS_YOU = "touches not confirmed"


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Allowed false alarms per joint and hour, and bounds of the contact levels [Nm], floors and
    ceilings (n,); half-gaps (n,) [rad]; whether a person confirmed to have caused every touch.

    The collision level is at least `collision_factor` times the contact level.
    """

    contact_per_hour: float
    collision_per_hour: float
    floor: Vector
    ceiling: Vector
    half_gap: Vector
    collision_factor: float = 3.0
    it_was_me: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion from which levels are identified, a row per tick.

    time_s (N,) [s]; position of the links (N, n) [rad]; velocity of the motors (N, n) [rad/s];
    residual (N, n) [Nm]; raised (N, n) [Nm]: raise of the thresholds near rest, without their
    growth with speed; touched (N, n): the joint exceeded its contact level; uncertain (N,): ticks
    in which the residual was old, or restarted. Neither of the latter two is used.
    """

    time_s: Vector
    position: Matrix
    velocity: Matrix
    residual: Matrix
    raised: Matrix
    touched: NDArray[np.bool_]
    uncertain: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Discarded:
    """Stretch that looked like a touch of one joint, and was left out."""

    at_s: float
    """from the start of the motion"""
    lasted_s: float
    largest: float
    """|r| of the joint [Nm]"""

    def __str__(self) -> str:
        return f"{self.largest:.2g} Nm at {self.at_s:.1f} s for {self.lasted_s:.1f} s"


@dataclass(frozen=True, slots=True)
class ObservedRange:
    """Range of a joint's motion from which its level was identified."""

    speed: float
    """of the motor, 99th percentile [rad/s]"""
    lower: float
    """of the link [rad]"""
    upper: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelsResult:
    """Levels of one joint [Nm], with the verdict on them."""

    joint: str
    verdict: LevelVerdict
    reason: str
    contact: float = float("nan")
    collision: float = float("nan")
    per_speed: float = 0.0
    """growth of both with the motor's speed [Nm s/rad]"""
    floored: bool = False
    """the contact level is its floor, as the motion needs less"""
    largest: float = float("nan")
    """|r| beyond the temporary raise of the threshold, in the motion used"""
    used_s: float = 0.0
    seen: ObservedRange = ObservedRange(0.0, 0.0, 0.0)
    discarded: tuple[Discarded, ...] = ()
    alone_s: float = float("nan")
    """Time [s] of a largest |r| beyond `_ALONE` times the rest, which is a touch, or rare"""


def identify_levels(
    joints: tuple[str, ...], period_s: float, motion: Motion, settings: LevelSettings
) -> list[LevelsResult]:
    """Two levels per joint, from `motion`. Raises LogError for numbers that are not finite."""
    if not (np.isfinite(motion.residual).all() and np.isfinite(motion.raised).all()):
        raise LogError("a residual in the log is not a number")
    per_block = max(1, round(BLOCK_S / period_s))
    count = len(motion.residual) // per_block
    complete = slice(0, count * per_block)
    frozen = _around(np.logical_or.reduce(motion.touched, axis=1) | motion.uncertain, period_s)
    blocks = _beyond(motion)[complete].reshape(count, per_block, -1)
    used = np.logical_and.reduce(~frozen[complete].reshape(count, per_block), axis=1)
    maxima = blocks.max(axis=1)
    gross = np.zeros_like(maxima, dtype=np.bool_)
    if used.any():
        gross = maxima > _GROSS * np.maximum(np.median(maxima[used], axis=0), 1e-9)
        gross &= (maxima > settings.floor) & used[:, None]
        used &= ~np.logical_or.reduce(gross, axis=1)
    share = 1.0 - float(used.mean()) if count else 1.0
    looks_touched = motion.touched.copy()
    looks_touched[complete] |= np.repeat(gross, per_block, axis=0)
    lists = [_stretches(motion, looks_touched[:, i], i, period_s) for i in range(len(joints))]
    speeds = np.abs(motion.velocity)[complete].reshape(count, per_block, -1)
    found = []
    for i, name in enumerate(joints):
        one = _of_joint(name, i, blocks[used, :, i], speeds[used, :, i], share, settings)
        one = replace(one, seen=_seen(motion, i), discarded=tuple(lists[i]),
                      alone_s=_alone(maxima[:, i], used))  # fmt: skip
        found.append(_doubted(one, lists, settings, i))
    return found


def _alone(maxima: Vector, used: NDArray[np.bool_]) -> float:
    """Time [s] of the used block whose maximum is far beyond those of all others (m,) but its
    neighbours, else NaN."""
    left = maxima * used
    k = int(np.argmax(left)) if used.any() else 0
    rest = np.delete(left, slice(max(k - 1, 0), k + 2)).max(initial=0.0)
    return BLOCK_S * k if used.sum() > FEWEST_BLOCKS and left[k] > _ALONE * rest else float("nan")


def _beyond(motion: Motion) -> Matrix:
    """|r| beyond the raise (N, n) [Nm]. At a joint that was raised most of the time, for example
    because its side of the gap never shows, it is all of |r|: the raise is proportional to the
    level in force, and would hide what a lower one has to cover."""
    raised = np.where((motion.raised > 0.0).mean(axis=0) > _MOSTLY, 0.0, motion.raised)
    return excess(motion.residual, raised)


def _around(touched: NDArray[np.bool_], period_s: float) -> NDArray[np.bool_]:
    width = 2 * round(FROZEN_AROUND_S / period_s) + 1
    return np.asarray(np.convolve(touched, np.ones(width), mode="same") > 0.5)


def _stretches(
    motion: Motion, touched: NDArray[np.bool_], i: int, period_s: float
) -> list[Discarded]:
    """Touches of one joint; those closer than the time excluded around each count as one."""
    spoilt = _around(touched, period_s)
    edges = np.flatnonzero(np.diff(spoilt, prepend=False, append=False))
    found = []
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        ticks = a + np.flatnonzero(touched[a:b])
        begin, end = motion.time_s[ticks[0]], motion.time_s[ticks[-1]] + period_s
        largest = float(np.abs(motion.residual[ticks, i]).max())
        found.append(Discarded(float(begin - motion.time_s[0]), float(end - begin), largest))
    return found


def _seen(motion: Motion, i: int) -> ObservedRange:
    lower, upper = np.percentile(motion.position[:, i], [0.5, 99.5])
    speed = float(np.percentile(np.abs(motion.velocity[:, i]), 99.0))
    return ObservedRange(speed, float(lower), float(upper))


def _doubted(
    one: LevelsResult, lists: Sequence[list[Discarded]], settings: LevelSettings, i: int
) -> LevelsResult:
    """`one`, unless its joint did not move, or looked touched in several stretches, unconfirmed."""
    travel = one.seen.upper - one.seen.lower
    least = LEAST_TRAVEL + 2.0 * float(settings.half_gap[i])
    if travel < least:
        about = (f"its link moved by {1e3 * travel:.2g} mrad, at least {1e3 * least:.0f} mrad are "
                 "needed for its level")  # fmt: skip
        return LevelsResult(joint=one.joint, verdict=LevelVerdict.STILL, reason=about,
                            used_s=one.used_s, seen=one.seen, discarded=one.discarded)  # fmt: skip
    all_of_them = sum(len(stretches) for stretches in lists)
    if one.verdict is LevelVerdict.GOOD and one.discarded and all_of_them > 1:
        if settings.it_was_me:
            return one
        about = (f"{all_of_them} stretches look like touches and were left out; if you did not "
                 "touch the arm, the level is too low: repeat hands off, or with --it-was-me if it "
                 "was you each time")  # fmt: skip
        return replace(one, verdict=LevelVerdict.UNLESS_YOU, reason=about)
    return one


def _of_joint(
    name: str, i: int, beyond: Matrix, speed: Matrix, frozen: float, settings: LevelSettings
) -> LevelsResult:
    """Levels from residual beyond the raise [Nm] and speed [rad/s], (blocks, ticks of a block)."""
    used_s = len(beyond) * BLOCK_S
    if frozen > _MOST_TOUCHED:
        about = f"contacts exclude {frozen:.0%} of the time: the arm was touched, or the old "
        return LevelsResult(joint=name, verdict=LevelVerdict.TOUCHED, used_s=used_s,
                      reason=about + "thresholds are far too low")  # fmt: skip
    if len(beyond) < FEWEST_BLOCKS:
        about = f"{used_s:.0f} s without a touch, at least {FEWEST_BLOCKS * BLOCK_S:.0f} s"
        return LevelsResult(joint=name, verdict=LevelVerdict.SHORT, reason=about, used_s=used_s)
    floor, ceiling = float(settings.floor[i]), float(settings.ceiling[i])
    per_speed = growth(beyond, speed, settings.contact_per_hour)
    at_rest = (beyond - per_speed * speed).max(axis=1)
    contact = max(_level(at_rest, settings.contact_per_hour), floor)
    collision = max(
        gumbel_level(at_rest, settings.collision_per_hour), settings.collision_factor * contact
    )
    found = LevelsResult(
        joint=name,
        verdict=LevelVerdict.GOOD,
        reason="",
        contact=contact,
        collision=collision,
        per_speed=per_speed,
        floored=contact == floor,
        largest=float(beyond.max()),
        used_s=used_s,
    )
    most = contact + per_speed * float(speed.max())
    if most > ceiling:
        about = f"{most:.3g} Nm are needed, at most {ceiling:.3g} Nm are allowed"
        return replace(found, verdict=LevelVerdict.CEILING, reason=about)
    return found


def growth(beyond: Matrix, speed: Matrix, per_hour: float) -> float:
    """Growth of a level with speed [Nm s/rad] that makes its mean the lowest at this rate of false
    alarms; 0 if that saves hardly anything. beyond: residual beyond the raise [Nm], speed [rad/s],
    both (blocks, ticks of a block)."""
    reach = float(speed.max())
    if reach <= 0.0:
        return 0.0
    constant = _level(beyond.max(axis=1), per_hour)
    candidates = _SPEEDS * constant / reach
    mean = [
        max(_level((beyond - one * speed).max(axis=1), per_hour), 0.0) + one * float(speed.mean())
        for one in candidates.tolist()
    ]
    best = int(np.argmin(mean))
    return float(candidates[best]) if mean[best] < (1.0 - _WORTH) * constant else 0.0


def _level(maxima: Vector, per_hour: float) -> float:
    """Level with this rate of false alarms, never below the largest value seen."""
    return max(gumbel_level(maxima, per_hour), 1.1 * float(maxima.max()))


def gumbel_level(maxima: Vector, per_hour: float) -> float:
    """Level that the maximum of a block exceeds `per_hour` times an hour, by a Gumbel distribution
    with the blocks' mean and deviation: u = mu - beta ln(-ln(1 - p)), p per block."""
    beta = float(np.std(maxima, ddof=1)) * np.sqrt(6.0) / np.pi
    mu = float(np.mean(maxima)) - 0.5772156649 * beta
    p = min(per_hour * BLOCK_S / 3600.0, 0.5)
    return float(mu - beta * np.log(-np.log1p(-p)))
