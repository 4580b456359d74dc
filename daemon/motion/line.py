"""Straight line through joint space with a trapezoidal speed profile. Pure."""

import math
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from daemon.motion.path import Reference

# Share of the acceleration limit that planned motion uses; the position loop has the rest.
PLANNED_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Line:
    """Line q(t) = start + s displacement, s(t) from 0 to 1 with a trapezoidal profile (n,).

    All joints start and arrive together, so no joint leaves the box that both ends span.
    """

    start: Vector  # [rad]
    displacement: Vector  # from start to end [rad]
    rate: float  # largest ds/dt [1/s]
    ramp_s: float  # from standstill to `rate`, and back

    @classmethod
    def between(cls, start: Vector, end: Vector, velocity: Vector, acceleration: Vector) -> "Line":
        """Fastest line within each joint's `velocity` [rad/s] and `acceleration` [rad/s2], (n,)."""
        displacement = end - start
        slowest = float(np.max(np.abs(displacement) / velocity))  # 1 / (ds/dt)
        if slowest == 0.0:
            return cls(start, displacement, math.inf, 0.0)
        steepest = float(np.max(np.abs(displacement) / acceleration))  # 1 / (d2s/dt2)
        rate = min(1.0 / slowest, 1.0 / math.sqrt(steepest))
        return cls(start, displacement, rate, rate * steepest)

    @property
    def duration_s(self) -> float:
        """Time from standstill to standstill [s]."""
        return 1.0 / self.rate + self.ramp_s

    def at(self, t: float) -> Reference:
        """Reference t [s] after the start."""
        if t >= self.duration_s:
            return Reference(self.start + self.displacement, np.zeros_like(self.displacement))
        before_end = self.duration_s - t
        if t < self.ramp_s:
            s, ds = 0.5 * self.rate * t * t / self.ramp_s, self.rate * t / self.ramp_s
        elif before_end < self.ramp_s:
            share = before_end / self.ramp_s
            s, ds = 1.0 - 0.5 * self.rate * before_end * share, self.rate * share
        else:
            s, ds = self.rate * (t - 0.5 * self.ramp_s), self.rate
        return Reference(self.start + s * self.displacement, ds * self.displacement)
