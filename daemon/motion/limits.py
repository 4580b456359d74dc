"""Limits of every setpoint: velocity, acceleration, and a braking distance before each joint limit.

Pure; arrays of shape (n,), SI units at the link side.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector, check_shapes
from daemon.motion.bounding import Bounding


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds per joint, each of shape (n,), and the time a setpoint takes to act."""

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector
    # Delay from a sample until the joint moves at the setpoint computed from it [s].
    reaction_s: float
    # Largest distance beyond a limit from which a joint may be moved back [rad].
    tolerance: float = 0.0
    _bounding: Bounding = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bounding = Bounding(
            self.lower, self.upper, self.velocity, self.acceleration, self.reaction_s
        )
        object.__setattr__(self, "_bounding", bounding)

    def bound_velocity(
        self, q: Vector, desired: Vector, before: Vector, dt: float, play: Vector | float = 0.0
    ) -> Vector:
        """Velocity (n,) [rad/s] nearest to `desired` that respects every limit.

        `play` (2, n) [rad] is the distance that the links may fall downwards and upwards in their
        gaps: a limit holds for every position of the link while its motor stands.

        `before` is the velocity commanded one interval `dt` [s] ago. Acceleration is respected
        first; only where the braking distance to a joint limit requires more deceleration than
        `acceleration` (a limit that was crossed already, a hand that pushed the arm there) does the
        funnel take precedence, as the joint would cross the limit otherwise.

        A velocity that is not finite counts as zero: the joint decelerates.
        """
        check_shapes(self.velocity.shape, q=q, desired=desired, before=before)
        bounded = np.empty_like(self.velocity)
        self._bounding.bound_velocity(q, desired, before, dt, self.each(play), bounded)
        return bounded

    def funnel(self, distance: Vector) -> Vector:
        """Largest speed [rad/s] towards a limit that is `distance` [rad] away, both (..., n), from
        which the joint still stops before it: v tau + v^2 / (2 a) = distance.

        v^2 / (2 a) is the braking distance, and v tau the travel before the setpoint takes effect.
        Near the limit the funnel is a loop, v = distance / tau, around the delay reaction_s: it
        comes to rest without overshoot from tau = e reaction_s up if that is a dead time, from
        4 reaction_s up if it is a first-order lag. It is some of each, so tau = 4 reaction_s.

        Zero at and beyond the limit, and where the distance is not a number: a joint whose
        position is not known does not move.
        """
        slack = 4.0 * self.reaction_s * self.acceleration
        room = np.fmax(distance, 0.0)  # 0 for NaN
        speed: Vector = np.sqrt(slack**2 + 2.0 * self.acceleration * room) - slack
        return speed

    def soft_stop(
        self, q: Vector, desired: Vector, gain: float, play: Vector | float = 0.0
    ) -> Vector:
        """Desired velocity (n,) [rad/s], at each limit replaced by a loop of that gain [1/s] on the
        distance to it: a joint that a hand pushed past its limit is led back to it."""
        check_shapes(self.velocity.shape, q=q, desired=desired)
        bounded = np.empty_like(self.velocity)
        self._bounding.soft_stop(q, desired, gain, self.each(play), bounded)
        return bounded

    def each(self, play: Vector | float) -> Vector:
        """`play` downwards and upwards, (2, n) [rad]."""
        if isinstance(play, np.ndarray):
            check_shapes((2, len(self.velocity)), play=play)
            return play
        return np.full((2, len(self.velocity)), play)

    def outside(self, q: Vector) -> NDArray[np.bool_]:
        """Mask (n,) of joints that stand beyond their limits by more than the tolerance."""
        return (q < self.lower - self.tolerance) | (q > self.upper + self.tolerance)


def all_finite(values: Vector) -> bool:
    """True if no value is NaN or infinite, by their sum. On so few values this is five times faster
    than numpy, whose reductions would cost more than anything else in a tick."""
    return math.isfinite(sum(values.tolist()))
