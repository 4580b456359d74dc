"""What no setpoint goes beyond: velocity, acceleration, and a braking distance before every joint
limit. Pure; arrays of shape (n,), SI units at the link side."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds per joint, each of shape (n,)."""

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector

    def bound_velocity(self, q: Vector, desired: Vector, before: Vector, dt: float) -> Vector:
        """The velocity nearest to `desired` that respects every limit.

        `before` is the velocity commanded one interval `dt` [s] ago. Acceleration is respected
        first; only where the braking distance to a joint limit asks for more deceleration than
        `acceleration` (a limit that was crossed already, a hand that pushed the arm there) does the
        funnel win, since the other way is through the limit.

        A velocity that is not finite counts as zero: the joint decelerates.
        """
        desired = np.where(np.isfinite(desired), desired, 0.0)
        desired = np.minimum(np.maximum(desired, -self.velocity), self.velocity)
        step = self.acceleration * dt
        bounded = np.minimum(np.maximum(desired, before - step), before + step)
        return np.minimum(
            np.maximum(bounded, -self.funnel(q - self.lower, dt)), self.funnel(self.upper - q, dt)
        )

    def funnel(self, distance: Vector, dt: float) -> Vector:
        """The largest speed [rad/s] towards a limit that is `distance` [rad] away, from which the
        joint still stops before it: v dt + v^2 / (2 a) = distance, for the setpoint is held for one
        interval before braking can begin. Zero at and beyond the limit, and where the distance is
        not a number: a joint that stands nobody knows where does not move."""
        a = self.acceleration
        room = np.where(distance > 0.0, distance, 0.0)
        return np.sqrt((a * dt) ** 2 + 2.0 * a * room) - a * dt

    def outside(self, q: Vector) -> NDArray[np.bool_]:
        """Joints that stand beyond their limits."""
        return (q < self.lower) | (q > self.upper)
