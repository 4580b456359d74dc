"""One tick's measurements of the whole arm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.cia402 import DriveState
from drivers.codec import Vector
from drivers.events import Event


@dataclass(slots=True)
class Samples:
    """Measurements, SI at the link side, one row per joint; states and events beside them.

    Reused: the next `collect` overwrites the arrays and the lists. A joint is fresh when all its
    TPDOs of this SYNC came in time; of any other the values are the last that came (NaN before
    the first), not necessarily of one SYNC, and `age_ticks` says for how many ticks.
    """

    current: Vector  # A
    link_position: Vector  # rad
    motor_velocity: Vector  # rad/s
    motor_position: Vector | None  # rad; None unless every drive sends it
    fresh: NDArray[np.bool_]
    age_ticks: NDArray[np.int64]
    states: list[DriveState]
    statuswords: list[int]  # -1 before the first
    events: tuple[Event, ...] = ()
