"""Scores of residuals in trials: delays, smallest steps, errors. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.alarms import excess


def filtered(external: Matrix, gain: float, period_s: float) -> Matrix:
    """A perfect residual of this gain, (3): r_dot = K (tau_ext - r), from r = 0.

    external: mean over each period.
    """
    TK = gain * period_s
    shown, r = np.empty_like(external), np.zeros(external.shape[1])
    for k, torque in enumerate(external):
        r = ((2.0 - TK) * r + 2.0 * TK * torque) / (2.0 + TK)
        shown[k] = r
    return shown


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Residuals of the pushed joint during a step. Torques count along the push."""

    joint: int
    size: float  # of the step [Nm], > 0
    delay_s: Vector  # (ticks,) of each SYNC after the onset in the plant
    residuals: Matrix  # (variants, ticks)
    before: Vector  # (variants,), at the last SYNC before the onset
    raised: Matrix  # (variants, ticks), of the threshold: in force less configured
    travelled: NDArray[np.bool_]  # (ticks,): link and rotor were apart at some time since the onset
    hidden: float  # [Nm] of the step that friction of the gear kept from the motor
    breakaway: float  # [Nm]: most torque that friction of this joint holds at rest, either way
    moving: bool  # the joint moved all the while: it neither stood nor turned


@dataclass(frozen=True, slots=True)
class Detection:
    """Detection of a step: its delay, and whether the gap was crossed until then."""

    delay_s: float
    travelled: bool


def detection(trial: Trial, variant: int, threshold: float) -> Detection | None:
    """Detection at the first SYNC with a residual beyond the threshold in the push's direction."""
    beyond = np.flatnonzero(trial.residuals[variant] > threshold + trial.raised[variant])
    if not beyond.size:
        return None
    first = int(beyond[0])
    return Detection(float(trial.delay_s[first]), bool(trial.travelled[first]))


def size_needed(trial: Trial, variant: int, threshold: float) -> float:
    """Smallest size of the step [Nm] that would have been detected.

    The residual is linear in the external torque and follows it whole: a step that is smaller by x
    lifts it x less. What the residual was beyond the threshold, the step could have been smaller.
    """
    return trial.size + threshold - float(np.max(trial.residuals[variant] - trial.raised[variant]))


@dataclass(slots=True)
class Errors:
    """Sum of squares over chosen samples, to be added up over runs."""

    squares: Vector
    count: NDArray[np.int64]

    @classmethod
    def of(cls, error: Matrix, chosen: NDArray[np.bool_]) -> "Errors":
        """Errors (ticks, n) where `chosen`."""
        return cls(
            np.asarray(np.sum(np.square(error), axis=0, where=chosen)),
            np.asarray(np.count_nonzero(chosen, axis=0)),
        )

    def __add__(self, other: "Errors") -> "Errors":
        return Errors(self.squares + other.squares, self.count + other.count)

    @property
    def rms(self) -> Vector:
        """(n,); 0 where nothing was chosen."""
        mean: Vector = np.sqrt(self.squares / np.maximum(self.count, 1))
        return mean


def percentile(values: Sequence[float], share: float) -> float:
    """Percentile of the values; NaN without any."""
    return float(np.percentile(values, share)) if len(values) else float("nan")


def count_alarms(residual: Matrix, threshold: Matrix | Vector) -> NDArray[np.int64]:
    """Number of times (n,) that each joint goes beyond its threshold: stretches, not ticks."""
    beyond = np.abs(residual) > threshold
    begins = beyond & ~np.vstack((np.zeros_like(beyond[:1]), beyond[:-1]))
    return np.asarray(np.count_nonzero(begins, axis=0))


def quiet_threshold(residual: Matrix, raised: Matrix) -> Vector:
    """The lowest threshold (n,) that, with its raise, is never exceeded [Nm]."""
    lowest: Vector = np.max(excess(residual, raised), axis=0)
    return lowest
