"""What no setpoint goes beyond: velocity, acceleration, and a braking distance before every joint
limit. Pure; arrays of shape (n,), SI units at the link side."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds per joint, each of shape (n,), and how long a setpoint takes to act."""

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector
    # From a sample until the joint moves as the setpoint that was made from it says [s].
    reaction_s: float

    def bound_velocity(self, q: Vector, desired: Vector, before: Vector, dt: float) -> Vector:
        """The velocity nearest to `desired` that respects every limit.

        `before` is the velocity commanded one interval `dt` [s] ago. Acceleration is respected
        first; only where the braking distance to a joint limit asks for more deceleration than
        `acceleration` (a limit that was crossed already, a hand that pushed the arm there) does the
        funnel win, since the other way is through the limit.

        A velocity that is not finite counts as zero: the joint decelerates.
        """
        if not all_finite(desired):
            desired = np.where(np.isfinite(desired), desired, 0.0)
        desired = np.minimum(np.maximum(desired, -self.velocity), self.velocity)
        step = self.acceleration * dt
        bounded = np.minimum(np.maximum(desired, before - step), before + step)
        down, up = self.funnel(np.array((q - self.lower, self.upper - q)))
        within: Vector = np.minimum(np.maximum(bounded, -down), up)
        return within

    def funnel(self, distance: Vector) -> Vector:
        """The largest speed [rad/s] towards a limit that is `distance` [rad] away, both (..., n),
        from which the joint still stops before it: v tau + v^2 / (2 a) = distance.

        v^2 / (2 a) is the braking distance, and v tau what the joint travels while the setpoint is
        on its way. Near the limit the funnel is a loop, v = distance / tau, around the delay
        reaction_s: it comes to rest without swinging across from tau = e reaction_s up if that is
        a dead time, from 4 reaction_s up if it is a first-order lag. It is some of each.

        Zero at and beyond the limit, and where the distance is not a number: a joint that stands
        nobody knows where does not move.
        """
        slack = 4.0 * self.reaction_s * self.acceleration
        room = np.fmax(distance, 0.0)  # 0 for NaN
        speed: Vector = np.sqrt(slack**2 + 2.0 * self.acceleration * room) - slack
        return speed

    def soft_stop(self, q: Vector, desired: Vector, gain: float) -> Vector:
        """`desired` [rad/s], at each limit replaced by a loop of that gain [1/s] on the distance
        to it: a push that yields the drive's velocity loop past a limit is led back to it."""
        towards_upper = np.minimum(desired, gain * (self.upper - q))
        bounded: Vector = np.maximum(towards_upper, gain * (self.lower - q))
        return bounded

    def outside(self, q: Vector) -> NDArray[np.bool_]:
        """Joints that stand beyond their limits."""
        return (q < self.lower) | (q > self.upper)


def all_finite(values: Vector) -> bool:
    """Whether no value is NaN or infinite: their sum would be, too. On so few values five times
    cheaper than to ask numpy, whose reductions cost more than all else in a tick."""
    return math.isfinite(sum(values.tolist()))
