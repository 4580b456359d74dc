"""Thresholds on the residual: the configured levels. `contact_detector` puts them in force."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from arrays import Vector
from errors import ModelError

Level = Literal["contact", "collision"]
LEVELS: tuple[Level, Level] = ("contact", "collision")
LEAST_SHARE = 0.2
"""Of a configured contact level: what learning leaves of it at least."""


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
