"""From residual to contact: thresholds, the subtractive dead-band, debounce, events."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from errors import ModelError
from estimator import memory
from estimator.types import Vector

Level = Literal["contact", "collision"]
LEVELS: tuple[Level, Level] = ("contact", "collision")


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Levels of |r| per joint [Nm], shape (n,), 0 < contact < collision; read-only arrays.

    Raises ModelError naming the row that is out of order.
    """

    contact: Vector
    collision: Vector
    per_speed: Vector = field(default_factory=lambda: np.array(0.0))
    """both grow by this times |theta_dot| [Nm s/rad], >= 0; one number stands for all"""

    def __post_init__(self) -> None:
        for name in LEVELS:
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if self.contact.ndim != 1 or self.contact.shape != self.collision.shape:
            raise ModelError(
                f"thresholds: contact {self.contact.shape}, collision {self.collision.shape}"
            )
        good = (self.contact > 0.0) & (self.contact < self.collision) & np.isfinite(self.collision)
        growth = np.broadcast_to(np.asarray(self.per_speed, dtype=np.float64), self.contact.shape)
        object.__setattr__(self, "per_speed", growth)
        if not np.all((growth >= 0.0) & np.isfinite(growth)):
            raise ModelError(f"thresholds: per_speed is {growth}; it must be >= 0")
        for i in np.flatnonzero(~good):
            raise ModelError(
                f"thresholds of joint {i + 1}: contact {self.contact[i]}, collision "
                f"{self.collision[i]}; it must be 0 < contact < collision"
            )


def dead_band(residual: Vector, threshold: Vector) -> Vector:
    """The thresholded residual sign(r) max(|r| - threshold, 0): no jump at the threshold."""
    return residual - np.minimum(np.maximum(residual, -threshold), threshold)


@dataclass(frozen=True, slots=True)
class Contact:
    """The residual of one joint stayed past a level for the debounce time."""

    joint: str
    torque: float
    """residual, signed [Nm]"""
    threshold: float
    """the level it passed, as in force in this tick [Nm]"""
    level: Level
    side: int
    """gap state of the joint, `motor_position.Side`"""
    time_s: float


class ContactDetector:
    """Thresholds in force, debounce and events.

    A contact begins when |r| has been past a level on one side for `debounce` ticks in a row; it
    ends when r comes back or changes its sign, and only then may the level fire again.

    gain: of the residual [1/s].
    """

    _MEMORY = ("raised", "streak")

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

    def step(self, residual: Vector, side: NDArray[np.int8], time_s: float) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level."""
        levels = self._levels + self._above
        if not np.count_nonzero(np.abs(residual) > levels[0]):
            self.streak[:] = 0
            return ()
        past = (residual > levels).astype(np.int64) - (residual < -levels)
        self.streak[:] = np.where(past * self.streak > 0, self.streak + past, past)
        begins = np.abs(self.streak) == self._debounce
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

    def reset(self) -> None:
        self.raised[:] = 0.0
        self.streak[:] = 0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: Mapping[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
