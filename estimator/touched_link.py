"""Which link is touched, from the pattern of the residual.

A force on a link turns its own joint and those before it; joints beyond the contact feel nothing.
So the link is that of the last joint that feels something: at least this one, and one further out
only if the force has no lever about the joints in between.
"""

import numpy as np

from estimator.types import Vector

FELT = 0.35
"""Share of its contact level that a joint does not reach by the model's errors alone."""
_UNSURE = 0.5 * FELT


def touched_link(residual: Vector, contact: Vector) -> int | None:
    """Index of the joint whose link is touched, for a residual (n,) [Nm] that is past the contact
    level (n,) [Nm] of at least one joint.

    None where nobody can tell: no joint feels it clearly, or a joint further out neither feels
    it clearly nor clearly feels nothing.
    """
    strength = np.abs(residual) / contact
    felt = np.flatnonzero(strength > FELT)
    if not felt.size:
        return None
    last = int(felt[-1])
    return None if np.any(strength[last + 1 :] > _UNSURE) else last
