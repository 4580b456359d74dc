"""Straight path to a pose: all joints start and arrive together, the furthest at the requested
speed, the others slower. A straight line through joint space leaves no box that contains both its
ends, so it stays within the joint limits; obstacles are not considered.

Unlike a path of displacements it leads to one pose: if a person has moved the arm meanwhile, it is
planned again from there.
"""

import math
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.line import PLANNED_SHARE


@dataclass(frozen=True, slots=True)
class PosePath:
    """Path from `start` to `goal`, both (n,) [rad], as a JointPath."""

    name: str
    start: Vector
    goal: Vector
    speed: Vector  # largest of each joint (n,) [rad/s]
    halts_at_contact: bool = True
    motors_only: bool = False
    begin: Vector | None = None

    @classmethod
    def planned(
        cls, name: str, start: Vector, goal: Vector, speed: float, limits: Limits, ramp_s: float
    ) -> "PosePath":
        """Path at `speed` [rad/s], less if a joint's limit of speed, or of acceleration within the
        `ramp_s` [s] of a Follower, requires it."""
        slowest = np.minimum(limits.velocity, PLANNED_SHARE * limits.acceleration * ramp_s)
        return cls(name, start, goal, np.minimum(speed, slowest))

    @property
    def displacement(self) -> Vector:
        """Signed distance of each joint (n,) [rad]."""
        return self.goal - self.start

    @property
    def duration(self) -> float:
        """Path time at its end [s]."""
        return float(np.max(np.abs(self.displacement) / self.speed))

    def offset(self, s: float) -> Vector:
        """Displacement from the start [rad] at path time s [s]."""
        duration = self.duration
        return self.displacement * (min(s / duration, 1.0) if duration else 1.0)

    def slope(self, s: float) -> Vector:
        """d offset / d s [rad/s]; constant along the path."""
        del s
        duration = self.duration
        return self.displacement / duration if duration else np.zeros_like(self.displacement)

    def extent(self, s: float) -> tuple[Vector, Vector]:
        """Offset of the goal [rad], as lowest and highest: from slightly outside the limits, the
        path leads inwards."""
        del s
        return self.displacement, self.displacement

    def fastest(self, s: float) -> Vector:
        """Largest speed [rad/s]."""
        return np.abs(self.slope(s))

    def continued_from(self, q: Vector) -> "PosePath":
        """Path from q (n,) [rad] to the same goal."""
        return PosePath(self.name, q.copy(), self.goal, self.speed)


def run_time_s(duration: float, ramp_s: float) -> float:
    """Time [s] from standstill to standstill that a Follower takes for a path of that duration
    [s]: it speeds up and slows down over `ramp_s`, on a short path not to full speed."""
    if duration >= ramp_s:
        return duration + ramp_s
    return 2.0 * math.sqrt(duration * ramp_s)
