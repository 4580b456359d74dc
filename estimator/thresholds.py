"""Thresholds on the residual: the configured levels, and their raise.

They are raised near rest, while the side of a joint's gap is unknown, and after samples that were
missing, by the torque that the residual cannot show, or may pretend, then.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from errors import ModelError
from estimator.motor_position import Side
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission

# Of the contact level, for each sample that was missing beyond the first, and at most: what the
# mean of both ends may be wrong by over an interval in which a motor crossed its gap.
_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
RAISED_PERIODS = 2.5
"""An interval of so many periods [-] raises the levels of its joint: two samples were missing."""

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


class ThresholdRaise:
    """Torques (n,) [Nm] that stiction may hold near rest, and that an unknown side, or samples that
    were missing, may pretend."""

    def __init__(
        self, transmission: Transmission, settings: EstimatorSettings, contact: Vector
    ) -> None:
        """contact: levels (n,) [Nm]."""
        t = transmission
        self._always = settings.stiction_share * t.engaged_coulomb
        self._held = t.stiction * t.engaged_coulomb
        self._missing, self._missing_most = _MISSING_SHARE * contact, _MISSING_MOST * contact
        self._unsure = settings.unknown_side_share * contact * (t.half_gap > 0.0)

    @property
    def most(self) -> Vector:
        """The raise (n,) [Nm] at rest with nothing known."""
        most: Vector = self._always + self._held + self._unsure
        return most

    def at(
        self,
        rest: Vector,
        unknown: Vector,
        side: NDArray[np.int8],
        periods: Vector | None = None,
    ) -> Vector:
        """The raise (n,) [Nm] in one tick.

        rest: `transmission.resting`; unknown: share of the stiction that may be anything; side:
        `Side`; periods: since the last sample, where one was missing; each (n,).
        """
        hidden = self._held * unknown
        hidden += self._always
        hidden *= rest
        hidden += self._unsure * (side == Side.UNKNOWN)
        if periods is not None:
            beyond = np.maximum(periods - 2.0, 0.0)
            hidden += np.minimum(beyond * self._missing, self._missing_most)
        return hidden
