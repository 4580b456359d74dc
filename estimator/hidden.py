"""What no residual tells of a joint: by so much its thresholds are raised."""

import numpy as np
from numpy.typing import NDArray

from estimator.motor_position import Side
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from estimator.types import Vector


class Hidden:
    """Torques (n,) [Nm] that stiction may hold near rest, and that an unknown side may pretend."""

    def __init__(
        self, transmission: Transmission, settings: EstimatorSettings, contact: Vector
    ) -> None:
        """contact: levels (n,) [Nm]."""
        t = transmission
        self._always = settings.stiction_share * t.engaged_coulomb
        self._held = t.stiction * t.engaged_coulomb
        self._unsure = settings.unknown_side_share * contact * (t.half_gap > 0.0)

    @property
    def most(self) -> Vector:
        """At rest, with nothing known."""
        most: Vector = self._always + self._held + self._unsure
        return most

    def at(self, rest: Vector, unknown: Vector, side: NDArray[np.int8]) -> Vector:
        """rest: `transmission.resting`; unknown: share of the stiction that may be anything;
        side: `Side`; each (n,)."""
        hidden = self._held * unknown
        hidden += self._always
        hidden *= rest
        hidden += self._unsure * (side == Side.UNKNOWN)
        return hidden
