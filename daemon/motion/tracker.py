"""Tracker of a moving target within limits of velocity, acceleration and jerk. Pure.

The desired velocity is the target's plus a correction of the distance to it: proportional to a
short distance, and for a long one the speed from which half of the acceleration still stops in
time. The velocity approaches it within the limits, so a target that jumps is approached within
them, and a target that moves within them is tracked without additional lag.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from common.arrays import Vector
from daemon.motion.path import Reference

# Gain on a short distance to the target [1/s].
GAIN: Final = 15.0
# Time constant of the velocity [s], and time to full acceleration [s].
LAG_S: Final = 0.02
JERK_S: Final = 0.04
# Share of the acceleration with which the approach to a target is planned.
BRAKING_SHARE: Final = 0.5


@dataclass(slots=True)
class Tracker:
    """Position q (n,) [rad] that tracks a target within `most_acceleration` (n,) [rad/s2],
    beginning at standstill."""

    q: Vector
    most_acceleration: Vector
    velocity: Vector = field(init=False)
    acceleration: Vector = field(init=False)

    def __post_init__(self) -> None:
        self.velocity = np.zeros_like(self.q)
        self.acceleration = np.zeros_like(self.q)

    def step(self, target: Vector, speed: Vector, most: Vector, dt: float) -> Reference:
        """Advance by dt [s] towards `target` (n,) [rad], which moves at `speed` (n,) [rad/s], at
        `most` (n,) [rad/s] or slower."""
        apart = target - self.q
        distance = np.abs(apart)
        braking = np.sqrt(2.0 * BRAKING_SHARE * self.most_acceleration * distance)
        wanted = speed + np.copysign(np.minimum(GAIN * distance, braking), apart)
        wanted = np.minimum(np.maximum(wanted, -most), most)
        fullest = self.most_acceleration
        change = fullest * (dt / JERK_S)
        push = (wanted - self.velocity) / max(LAG_S, dt)
        push = np.minimum(np.maximum(push, self.acceleration - change), self.acceleration + change)
        push = np.minimum(np.maximum(push, -fullest), fullest)
        return self._advance(self.velocity + push * dt, dt)

    def brake(self, q: Vector, fullest: Vector, dt: float) -> Reference:
        """Advance by dt [s] towards standstill, with the acceleration `fullest` (n,) [rad/s2] at
        once. While a joint moves, its position is the measured q (n,) [rad]: otherwise the position
        loop would drive it on to where it should have been."""
        self.q = np.where(self.velocity != 0.0, q, self.q)
        most = fullest * dt
        slower = self.velocity - np.minimum(np.maximum(self.velocity, -most), most)
        self.acceleration = (slower - self.velocity) / dt
        self.velocity = slower
        return Reference(self.q, slower)

    def _advance(self, velocity: Vector, dt: float) -> Reference:
        self.acceleration = (velocity - self.velocity) / dt
        self.q = self.q + 0.5 * (self.velocity + velocity) * dt
        self.velocity = velocity
        return Reference(self.q, velocity)
