"""Scores of residuals in trials: delays, smallest steps, errors. Pure functions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.alarms import excess


def filtered(external: Matrix, gain: float, period_s: float) -> Matrix:
    """Ideal residual of this gain, (3): r_dot = K (tau_ext - r), from r = 0.

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
    raised: Matrix  # (variants, ticks), of the threshold: in force minus configured
    travelled: NDArray[np.bool_]  # (ticks,): the gap was entered since the onset
    hidden: float  # [Nm] of the step that gear friction hid from the motor
    breakaway: float  # [Nm]: largest torque that this joint's friction holds at rest
    moving: bool  # continuous motion, without standstill or reversal


@dataclass(frozen=True, slots=True)
class Detection:
    """Detection of a step: its delay, and whether the gap was crossed before."""

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
    """Smallest step [Nm] that would have been detected.

    The residual is linear in the external torque and reaches it fully: a step smaller by x raises
    it by x less. The step could have been smaller by the residual's excess over the threshold.
    """
    return trial.size + threshold - float(np.max(trial.residuals[variant] - trial.raised[variant]))


@dataclass(slots=True)
class Errors:
    """Sums of squares over chosen samples, which can be added over runs."""

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
        """Root mean square (n,); 0 if nothing was chosen."""
        mean: Vector = np.sqrt(self.squares / np.maximum(self.count, 1))
        return mean


def percentile(values: Sequence[float], share: float) -> float:
    """Percentile of the values; NaN without any."""
    return float(np.percentile(values, share)) if len(values) else float("nan")


def count_alarms(residual: Matrix, threshold: Matrix | Vector) -> NDArray[np.int64]:
    """Number of times (n,) that each joint exceeds its threshold: stretches, not ticks."""
    beyond = np.abs(residual) > threshold
    begins = beyond & ~np.vstack((np.zeros_like(beyond[:1]), beyond[:-1]))
    return np.asarray(np.count_nonzero(begins, axis=0))


def quiet_threshold(residual: Matrix, raised: Matrix) -> Vector:
    """Lowest threshold (n,) that, with its raise, is never exceeded [Nm]."""
    lowest: Vector = np.max(excess(residual, raised), axis=0)
    return lowest
