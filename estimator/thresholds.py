"""Configured thresholds on the residual. `levels` computes those in force."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from common.arrays import Vector
from common.errors import ModelError

Level = Literal["contact", "collision"]
LEVELS: tuple[Level, Level] = ("contact", "collision")
LEAST_SHARE = 0.2
"""Least share of a configured contact level that learning leaves in force."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Levels of |r| per joint [Nm], shape (n,), 0 < contact < collision; read-only arrays.

    Raises ModelError naming the row that is out of order.
    """

    contact: Vector
    collision: Vector
    per_speed: Vector = field(default_factory=lambda: np.array(0.0))
    """both grow by this times |theta_dot| [Nm s/rad], >= 0; a single number applies to all"""
    least_share: Vector = field(default_factory=lambda: np.array(LEAST_SHARE))
    """least share of the contact level that learning leaves, LEAST_SHARE to 1; likewise"""

    def __post_init__(self) -> None:
        for name in LEVELS:
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if self.contact.ndim != 1 or self.contact.shape != self.collision.shape:
            raise ModelError(
                f"thresholds: contact has shape {self.contact.shape}, collision "
                f"{self.collision.shape}; they must be equal, and one-dimensional"
            )
        good = (self.contact > 0.0) & (self.contact < self.collision) & np.isfinite(self.collision)
        growth = np.broadcast_to(np.asarray(self.per_speed, dtype=np.float64), self.contact.shape)
        object.__setattr__(self, "per_speed", growth)
        if not np.all((growth >= 0.0) & np.isfinite(growth)):
            raise ModelError(f"thresholds: per_speed is {growth}; it must be >= 0")
        least = np.broadcast_to(np.asarray(self.least_share, dtype=np.float64), growth.shape)
        object.__setattr__(self, "least_share", least)
        if not np.all((least >= LEAST_SHARE) & (least <= 1.0)):
            raise ModelError(f"thresholds: least_share is {least}; it must be {LEAST_SHARE:g} to 1")
        for i in np.flatnonzero(~good):
            raise ModelError(
                f"thresholds of joint {i + 1}: contact {self.contact[i]}, collision "
                f"{self.collision[i]}; it must be 0 < contact < collision"
            )
