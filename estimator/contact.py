"""Contact: the subtractive dead-band, the event, and the touched link.

A force on a link acts on its own joint and on those before it; the residuals of joints beyond the
contact stay small. So the touched link is that of the last joint whose residual is clear: at least
this one, and one further out only if the force has no lever about the joints in between.
"""

from dataclasses import dataclass

import numpy as np

from arrays import Vector
from estimator.thresholds import Level

CLEAR = 0.35
"""Share of its contact level that a residual does not reach by the model's errors alone."""
_ABSENT = 0.5 * CLEAR


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
