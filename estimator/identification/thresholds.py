"""Thresholds from contact-free motion, at a chosen rate of false alarms."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from errors import LogError
from estimator.alarms import excess

BLOCK_S = 1.0
"""The largest |r| of each such block is one draw of an extreme-value distribution."""
FEWEST_BLOCKS = 30
FROZEN_AROUND_S = 0.5
"""A touch also spoils what lies so close to it."""
_GROSS = 5.0  # times the median block: a touch, however high the old threshold is
_MOST_TOUCHED = 0.2


class LevelVerdict(StrEnum):
    """Verdict on new levels: `good`, or the reason why the old ones stay."""

    GOOD = "good"
    CEILING = "above the ceiling"
    TOUCHED = "touched too often"
    SHORT = "too little motion"


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Allowed false alarms per joint and hour, and bounds of the contact levels [Nm], floors and
    ceilings (n,).

    The collision level is at least `collision_factor` times the contact level.
    """

    contact_per_hour: float
    collision_per_hour: float
    floor: Vector
    ceiling: Vector
    collision_factor: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelsResult:
    """Levels of one joint [Nm], with the verdict on them."""

    joint: str
    verdict: LevelVerdict
    reason: str
    contact: float = float("nan")
    collision: float = float("nan")
    floored: bool = False
    """the contact level is its floor: less was seen"""
    largest: float = float("nan")
    """|r| without the raise near rest, in what was not frozen"""
    used_s: float = 0.0


def identify_levels(
    joints: tuple[str, ...],
    period_s: float,
    residual: Matrix,
    raised: Matrix,
    touched: NDArray[np.bool_],
    settings: LevelSettings,
) -> list[LevelsResult]:
    """Two levels per joint from residuals (N, n) [Nm].

    raised (N, n): what the thresholds were raised by near rest, as the new ones will be; touched
    (N,): ticks in which any joint was past its contact level, from which nothing is learned.

    Raises LogError for numbers that are not finite.
    """
    if not (np.isfinite(residual).all() and np.isfinite(raised).all()):
        raise LogError("a residual in the log is not a number")
    per_block = max(1, round(BLOCK_S / period_s))
    around = round(FROZEN_AROUND_S / period_s)
    frozen = np.convolve(touched, np.ones(2 * around + 1), mode="same") > 0.5
    count = len(residual) // per_block
    maxima = excess(residual, raised)[: count * per_block].reshape(count, per_block, -1).max(axis=1)
    open_blocks = ~frozen[: count * per_block].reshape(count, per_block).any(axis=1)
    if open_blocks.any():
        gross = maxima > _GROSS * np.maximum(np.median(maxima[open_blocks], axis=0), 1e-9)
        gross &= maxima > settings.floor
        open_blocks &= ~gross.any(axis=1)
    share = 1.0 - float(open_blocks.mean()) if count else 1.0
    used = maxima[open_blocks]
    return [_of_joint(name, i, used, share, settings) for i, name in enumerate(joints)]


def _of_joint(
    name: str, i: int, maxima: Matrix, frozen: float, settings: LevelSettings
) -> LevelsResult:
    used_s = len(maxima) * BLOCK_S
    if frozen > _MOST_TOUCHED:
        about = f"contacts froze {frozen:.0%} of the time: somebody touched the arm, or the old "
        return LevelsResult(joint=name, verdict=LevelVerdict.TOUCHED, used_s=used_s,
                      reason=about + "thresholds are far too low")  # fmt: skip
    if len(maxima) < FEWEST_BLOCKS:
        about = f"{used_s:.0f} s without a touch, at least {FEWEST_BLOCKS * BLOCK_S:.0f} s"
        return LevelsResult(joint=name, verdict=LevelVerdict.SHORT, reason=about, used_s=used_s)
    largest = float(maxima[:, i].max())
    floor, ceiling = float(settings.floor[i]), float(settings.ceiling[i])
    # Never below what was seen, whatever the distribution says.
    contact = max(gumbel_level(maxima[:, i], settings.contact_per_hour), 1.1 * largest, floor)
    collision = max(
        gumbel_level(maxima[:, i], settings.collision_per_hour),
        settings.collision_factor * contact,
    )
    found = LevelsResult(
        joint=name,
        verdict=LevelVerdict.GOOD,
        reason="",
        contact=contact,
        collision=collision,
        floored=contact == floor,
        largest=largest,
        used_s=used_s,
    )
    if contact > ceiling:
        about = f"{contact:.3g} Nm are needed, at most {ceiling:.3g} Nm are allowed"
        return replace(found, verdict=LevelVerdict.CEILING, reason=about)
    return found


def gumbel_level(maxima: Vector, per_hour: float) -> float:
    """Level that the maximum of a block exceeds `per_hour` times an hour, by a Gumbel distribution
    of the blocks' mean and deviation: u = mu - beta ln(-ln(1 - p)), p per block."""
    beta = float(np.std(maxima, ddof=1)) * np.sqrt(6.0) / np.pi
    mu = float(np.mean(maxima)) - 0.5772156649 * beta
    p = min(per_hour * BLOCK_S / 3600.0, 0.5)
    return float(mu - beta * np.log(-np.log1p(-p)))
