"""Witness of a hand: the part of the residual that may move an arm that yields.

Learned friction and levels serve to detect contacts, but are no evidence of a person. The arm is
therefore moved

- by the residual only as far as it is present without the learned friction, too: by the smaller of
  the two, and not at all where their signs differ;
- from the stated level on, however far learning has lowered the level in force. The latter counts
  while a hand is witnessed on the joint, and for ALONE_S after it.

A hand is witnessed where the residual exceeds the stated level, and exceeds the configured one by
the whole identified friction: the motor is then driven instead of driving, whatever friction is.
Only from such a hand does an arm back away, and only for one, on any joint, does a guide turn
joints. A joint that moves in the direction of its residual without that moves because of an error,
or of a hand too light to be distinguished from one: after ALONE_S it stands, until a hand is
witnessed or the residual has been below its level.

Pure; time is an argument; arrays of shape (n,).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from estimator.contact import dead_band

#: Longest time and distance of motion by a push that friction could explain [s], [rad].
ALONE_S: Final = 0.1
ALONE_RAD: Final = 0.008
#: Share of both that leaks per second without such motion.
LEAK: Final = 0.5
#: Speed below which a joint that has stopped is settling in its gear [rad/s].
SETTLES: Final = 0.02


@dataclass(frozen=True, slots=True)
class IndependentResidual:
    """Residual of a tick as far as it is independent of learning [Nm], with the level in force, the
    stated and the configured one [Nm]."""

    agreed: Vector
    threshold: Vector
    stated: Vector
    configured: Vector


def agreed(residual: Vector, uncorrected: Vector) -> Vector:
    """Smaller of the residuals with and without learned friction [Nm]; 0 where their signs
    differ."""
    low, high = np.minimum(residual, uncorrected), np.maximum(residual, uncorrected)
    return np.maximum(low, 0.0) + np.minimum(high, 0.0)


def beyond_stated(independent: IndependentResidual) -> Vector:
    """Thresholded residual [Nm] of a contact that begins, at the stated level."""
    return dead_band(independent.agreed, independent.stated)


class HandWitness:
    """Watch on one arm while it yields."""

    def __init__(self, coulomb: Vector, viscous: Vector) -> None:
        """coulomb [Nm], viscous [Nm s/rad]: identified friction of motor and link."""
        self._coulomb, self._viscous = coulomb, viscous
        n = len(coulomb)
        self._alone_s, self._alone_rad, self._seen_s = np.zeros((3, n))
        self.stands = np.zeros(n, dtype=np.bool_)
        """True for a joint that is held because it moved without a witnessed hand (n,)"""
        self.hand = self.leads = False
        """True once a hand was witnessed since the arm began to yield; and in the last ALONE_S"""
        self.excess: Vector = np.zeros(n)
        """residual beyond what witnesses a hand (n,) [Nm]; against the residual where it is less"""

    def begin(self) -> None:
        """Reset when the arm begins to yield: no hand has been witnessed yet."""
        self._alone_s[:] = self._alone_rad[:] = self._seen_s[:] = 0.0
        self.stands[:] = self.hand = self.leads = False

    def witnessed(
        self, independent: IndependentResidual, motor_velocity: Vector
    ) -> NDArray[np.bool_]:
        """Joints (n,) on which a hand is witnessed in this tick."""
        hand: NDArray[np.bool_] = self._beyond(independent, motor_velocity) > 0.0
        return hand

    def _beyond(self, independent: IndependentResidual, motor_velocity: Vector) -> Vector:
        """Size of the residual beyond what witnesses a hand (n,) [Nm]; negative where it is less"""
        friction = self._coulomb + self._viscous * np.abs(motor_velocity)
        least = np.maximum(independent.stated, independent.configured + friction)
        beyond: Vector = np.abs(independent.agreed) - least
        return beyond

    def step(self, independent: IndependentResidual, motor_velocity: Vector, dt: float) -> Vector:
        """Thresholded residual [Nm] that may move the arm in the next dt [s]."""
        size, speed = np.abs(independent.agreed), np.abs(motor_velocity)
        beyond = self._beyond(independent, motor_velocity)
        hand, self.excess = beyond > 0.0, np.sign(independent.agreed) * beyond
        self.hand = self.hand or bool(hand.any())
        self._seen_s = np.where(hand, ALONE_S, np.maximum(self._seen_s - dt, 0.0))
        self.leads = bool((seen := self._seen_s > 0.0).any())
        along = (independent.agreed * motor_velocity > 0.0) & (size > independent.threshold) & ~seen
        moves = along & (speed > SETTLES)
        kept = np.where(hand, 0.0, 1.0 - LEAK * dt * ~along)
        self._alone_s = kept * self._alone_s + dt * moves
        self._alone_rad = kept * self._alone_rad + np.where(along, dt * speed, 0.0)  # not NaN
        gone = size <= independent.threshold
        alone = (self._alone_s > ALONE_S) | (self._alone_rad > ALONE_RAD)
        self.stands = ((self.stands & ~gone) | (alone & along)) & ~hand
        push = dead_band(
            independent.agreed, np.where(seen, independent.threshold, independent.stated)
        )
        return np.where(self.stands, 0.0, push)
