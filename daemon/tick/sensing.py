"""Watch on the sensing of contact: which joints sense now, since when, and whether to rely on it.

Pure; time is an argument.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from estimator.estimate import Estimate, Flag

#: Time constants of the residual until one that began anew, at zero, says what it will.
SETTLED: Final = 4.0
#: Flags of an estimate that is right all the same: true intervals were used, gaps were bridged.
_HARMLESS: Final = Flag.LATE | Flag.BRIDGED


class Sensing:
    """Sensing of an arm of n joints, as of the last `step`."""

    def __init__(self, n: int, gain: float) -> None:
        """gain: of the residual [1/s]."""
        self.joints: NDArray[np.bool_] = np.zeros(n, dtype=np.bool_)
        """which joints sense contact (n,)"""
        self.since_s: Vector = np.zeros(n)
        """when that last changed, of each (n,) [s]"""
        self.sure = False
        """Every joint senses, and no residual is still on its way up from zero."""
        self._settles_s = SETTLED / gain
        self._unsure_s = -np.inf

    def step(self, time_s: float, estimate: Estimate | None) -> None:
        """Take the estimate of this tick; None while there is none."""
        if estimate is None:
            return
        if estimate.flags & ~_HARMLESS:
            self._unsure_s = time_s
        now = estimate.sensing
        changed = now != self.joints
        if changed.any():
            self.since_s = np.where(changed, time_s, self.since_s)
            self.joints = now
        settled = time_s - self._unsure_s > self._settles_s
        self.sure = settled and bool(now.all())
