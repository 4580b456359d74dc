"""Contact detection: the subtractive dead-band, debounce and events, and the touched link.

A force on a link acts on its own joint and on those before it; the residuals of joints beyond the
contact stay small. So the touched link is that of the last joint whose residual is clear: at least
this one, and one further out only if the force has no lever about the joints in between.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from errors import ModelError
from estimator import memory
from estimator.kernel import Kernel
from estimator.thresholds import LEVELS, Level, Thresholds

CLEAR = 0.35
"""Share of its contact level that a residual does not reach by the model's errors alone."""
_ABSENT = 0.5 * CLEAR
WAITS = 2
"""Ticks for which a contact beside a missing sample may wait for it."""


def dead_band(residual: Vector, threshold: Vector) -> Vector:
    """The thresholded residual sign(r) max(|r| - threshold, 0): no jump at the threshold."""
    return residual - np.minimum(np.maximum(residual, -threshold), threshold)


@dataclass(frozen=True, slots=True)
class Contact:
    """Start of a contact: the residual of one joint stayed past a level for the debounce time."""

    joint: str
    torque: float
    """residual, signed [Nm]"""
    threshold: float
    """the level it passed, as in force in this tick [Nm]"""
    level: Level
    side: int
    """gap state of the joint, `motor_position.Side`"""
    time_s: float


class Touch:
    """What the kernel counted of each joint's residual, as contacts."""

    def __init__(
        self, joints: Sequence[str], thresholds: Thresholds, kernel: Kernel, debounce: int
    ) -> None:
        self._joints, self._debounce = tuple(joints), debounce
        self._levels = np.stack([thresholds.contact, thresholds.collision])
        self._streak, self._begins = np.asarray(kernel.streak), np.asarray(kernel.begins)
        self._above, self._side = np.asarray(kernel.above), np.asarray(kernel.rotors.side)
        self._residual = np.asarray(kernel.residual)

    def begun(self, time_s: float) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level."""
        if not np.count_nonzero(self._begins):
            return ()
        levels = self._levels + self._above
        return tuple(
            Contact(
                joint=self._joints[i],
                torque=float(self._residual[0, i]),
                threshold=float(levels[level, i]),
                level=LEVELS[level],
                side=int(self._side[i]),
                time_s=time_s,
            )
            for level, i in np.argwhere(self._begins)
        )

    def touched(self) -> NDArray[np.bool_]:
        """Joints that are past their contact level now, debounced; shape (n,)."""
        touched: NDArray[np.bool_] = np.abs(self._streak[0]) >= self._debounce
        return touched

    def hit(self) -> NDArray[np.bool_]:
        """Joints that are past their collision level now, debounced; shape (n,)."""
        hit: NDArray[np.bool_] = np.abs(self._streak[1]) >= self._debounce
        return hit

    @property
    def collision(self) -> Vector:
        """Collision levels in force [Nm], shape (n,)."""
        in_force: Vector = self._levels[1] + self._above
        return in_force


class ContactDetector:
    """Thresholds in force, debounce and events.

    A contact begins when |r| has been past a level on one side for `debounce` ticks in a row; it
    ends when r comes back or changes its sign, and only then may the level fire again.

    gain: of the residual [1/s].
    """

    _MEMORY = ("raised", "streak", "waited")

    def __init__(
        self,
        joints: Sequence[str],
        thresholds: Thresholds,
        *,
        gain: float,
        debounce: int = 1,
    ) -> None:
        n = len(joints)
        if thresholds.contact.shape != (n,):
            raise ModelError(f"thresholds for {thresholds.contact.size} joints, the arm has {n}")
        if debounce < 1:
            raise ModelError(f"debounce is {debounce} ticks; at least 1")
        self._joints = tuple(joints)
        self._levels = np.stack([thresholds.contact, thresholds.collision])
        self._per_speed = thresholds.per_speed if np.any(thresholds.per_speed) else None
        self._gain = gain
        self._debounce = debounce
        self.raised = np.zeros(n)
        self._above = self.raised  # what is added to both levels in this tick
        # Ticks in a row past each level, signed as the residual.
        self.streak = np.zeros((2, n), dtype=np.int64)
        # Ticks for which a contact has waited for the sample of another joint.
        self.waited = np.zeros((2, n), dtype=np.int64)

    def thresholds(self, hidden: Vector, theta_dot: Vector, dt: float) -> Vector:
        """Contact thresholds in force [Nm], raised by what stiction may hide in this tick, `hidden`
        (n,) [Nm], and by `Thresholds.per_speed` in motion.

        After break-away friction still builds up while the residual forgets what stiction left in
        it, so the raise fades with half the residual's gain.
        """
        raised = self.raised
        np.multiply(raised, math.exp(-0.5 * self._gain * dt), out=raised)
        np.maximum(raised, hidden, out=raised)
        self._above = raised
        if self._per_speed is not None:
            self._above = raised + self._per_speed * np.abs(theta_dot)
        in_force: Vector = self._levels[0] + self._above
        return in_force

    def step(
        self,
        residual: Vector,
        side: NDArray[np.int8],
        time_s: float,
        absent: NDArray[np.bool_] | None = None,
    ) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level.

        What counts of joints that are `absent` (n,), without a new sample, is what counted before.
        Beside them a contact waits, for `WAITS` ticks at most, for the tick that shows whether they
        went on as they were taken to: what they did else is a torque on the others until then.
        """
        levels = self._levels + self._above
        if absent is None and not np.count_nonzero(np.abs(residual) > levels[0]):
            self.streak[:] = 0
            self.waited[:] = 0
            return ()
        past = (residual > levels).astype(np.int64) - (residual < -levels)
        streak = np.where(past * self.streak > 0, self.streak + past, past)
        begins = np.abs(streak) == self._debounce
        if absent is not None:
            streak = np.where(absent, self.streak, streak)
            waits = begins & ~absent & (self.waited < WAITS)
            self.waited[waits] += 1
            streak = np.where(waits, self.streak, streak)
            begins &= ~absent & ~waits
        self.waited *= (past != 0) & ~begins
        self.streak[:] = streak
        if not begins.any():
            return ()
        return tuple(
            Contact(
                joint=self._joints[i],
                torque=float(residual[i]),
                threshold=float(levels[level, i]),
                level=LEVELS[level],
                side=int(side[i]),
                time_s=time_s,
            )
            for level, i in np.argwhere(begins)
        )

    def touched(self) -> NDArray[np.bool_]:
        """Joints that are past their contact level now, debounced; shape (n,)."""
        touched: NDArray[np.bool_] = np.abs(self.streak[0]) >= self._debounce
        return touched

    def hit(self) -> NDArray[np.bool_]:
        """Joints that are past their collision level now, debounced; shape (n,)."""
        hit: NDArray[np.bool_] = np.abs(self.streak[1]) >= self._debounce
        return hit

    @property
    def collision(self) -> Vector:
        """Collision levels in force [Nm], shape (n,)."""
        in_force: Vector = self._levels[1] + self._above
        return in_force

    def reset(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget the raise and all contacts, of these joints or of all."""
        self.raised[joints] = 0.0
        self.streak[:, joints] = 0
        self.waited[:, joints] = 0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: Mapping[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)


def touched_link(residual: Vector, contact: Vector) -> int | None:
    """Index of the joint whose link is touched, for a residual (n,) [Nm] that is past the contact
    level (n,) [Nm] of at least one joint.

    None where it cannot be decided: no residual is clear, or that of a joint further out is neither
    clear nor clearly absent.
    """
    strength = np.abs(residual) / contact
    clear = np.flatnonzero(strength > CLEAR)
    if not clear.size:
        return None
    last = int(clear[-1])
    return None if np.any(strength[last + 1 :] > _ABSENT) else last
