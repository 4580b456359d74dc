"""Contact event, and dead band of the thresholded residual. `contact_detector` detects contacts."""

from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from estimator.thresholds import Level


def dead_band(residual: Vector, threshold: Vector) -> Vector:
    """Thresholded residual sign(r) max(|r| - threshold, 0): continuous at the threshold."""
    return residual - np.minimum(np.maximum(residual, -threshold), threshold)


@dataclass(frozen=True, slots=True)
class Contact:
    """Start of a contact: the residual of one joint exceeded a level for the debounce time."""

    joint: str
    torque: float
    """residual, signed [Nm]"""
    threshold: float
    """level that it exceeded, as in force in this tick [Nm]"""
    level: Level
    side: int
    """gap state of the joint, `motor_position.Side`"""
    time_s: float
