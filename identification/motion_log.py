"""Log of samples that every identification step reads."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import LogError, ShortLogError

SHORTEST = 100
"""Least number of samples for any identification."""
PAUSE_S = 1.0
"""Interval after which the motor may stand elsewhere, and an encoder may have another zero [s]."""


@dataclass(frozen=True, slots=True)
class MotionLog:
    """Samples of all joints, SI at the link side; matrices of shape (N, n).

    Raises LogError naming joint, column and sample where a number is not finite, the shapes differ,
    time does not grow, or there are fewer than `SHORTEST` samples.
    """

    joints: tuple[str, ...]
    time_s: Vector
    """(N,)"""
    current: Matrix
    """[A]"""
    link_position: Matrix
    """[rad]"""
    motor_velocity: Matrix
    """[rad/s]"""
    motor_position: Matrix | None = None
    """[rad], if the drives report it"""
    setpoint: Matrix | None = None
    """Target velocity of each sample's tick, which drives get with the next SYNC [rad/s]; None if
    it is not in the log"""

    def __post_init__(self) -> None:
        size, n = len(self.time_s), len(self.joints)
        if size < SHORTEST:
            raise ShortLogError(
                f"the log is too short: {size} samples, at least {SHORTEST} are needed"
            )
        for name in ("current", "link_position", "motor_velocity", "motor_position", "setpoint"):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (size, n):
                raise LogError(f"{name} has shape {values.shape}, expected {(size, n)}")
            bad = np.argwhere(~np.isfinite(values))
            if len(bad):
                k, i = bad[0]
                raise LogError(
                    f"{name} of {self.joints[i]} is {values[k, i]} at sample {k}"
                    f" ({len(bad)} such in the log)"
                )
        if not np.isfinite(self.time_s).all():
            raise LogError(f"time is not a number at sample {np.argmin(np.isfinite(self.time_s))}")
        steps = np.diff(self.time_s)
        if not (steps > 0.0).all():
            k = int(np.argmin(steps > 0.0)) + 1
            raise LogError(f"time does not grow at sample {k} ({self.time_s[k]} s)")

    @property
    def n(self) -> int:
        return len(self.joints)

    @property
    def period_s(self) -> float:
        """Median interval [s]."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def measured_s(self) -> float:
        """Duration without gaps between samples [s]."""
        return sum(float(self.time_s[s.stop - 1] - self.time_s[s.start]) for s in self.stretches())

    def select(self, rows: slice | NDArray[np.bool_]) -> "MotionLog":
        """Selected samples of the log: a time range or a boolean mask."""
        position, setpoint = (
            None if values is None else values[rows]
            for values in (self.motor_position, self.setpoint)
        )
        return replace(
            self,
            time_s=self.time_s[rows],
            current=self.current[rows],
            link_position=self.link_position[rows],
            motor_velocity=self.motor_velocity[rows],
            motor_position=position,
            setpoint=setpoint,
        )

    def stretches(self, pause_s: float = 0.0) -> list[slice]:
        """Runs without a missing sample (an interval beyond two periods), or without a pause."""
        longest = max(pause_s, 2.0 * self.period_s)
        cuts = np.flatnonzero(np.diff(self.time_s) > longest) + 1
        edges = [0, *cuts.tolist(), len(self.time_s)]
        return [slice(a, b) for a, b in itertools.pairwise(edges)]
