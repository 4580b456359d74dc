"""Ignored setpoints: a drive in operation reports not following its target velocity. Pure.

In cyclic synchronous velocity, bit 12 of the statusword means that the drive follows its command
(CiA 402-2). It is cleared when another tool selects another mode of operation. A drive at its
current limit may clear it, too, which is not a fault of this kind. Not every drive has the bit: one
that has never set it is not judged by it.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from drivers.canopen.cia402 import DriveState

#: "Drive follows the command value" of the statusword.
FOLLOWS: Final = 1 << 12
#: Ticks for which it must be clear: on entering operation a drive may set it with a delay.
IGNORED_TICKS: Final = 3
#: A drive that gives this share of its current limit may be limited rather than in another mode.
LIMITED_SHARE: Final = 0.5


class IgnoredSetpoints:
    """Monitor of that bit of every drive of an arm."""

    def __init__(self, current_limit: Vector) -> None:
        """current_limit: (n,) [A]."""
        self._limited = LIMITED_SHARE * current_limit
        n = len(current_limit)
        self._known = [False] * n  # it has set the bit
        self._ticks = [0] * n

    def restart(self) -> None:
        """Forget which drives have the bit: the drives may be others now."""
        self._known = [False] * len(self._known)
        self._ticks = [0] * len(self._ticks)

    def joints(
        self,
        states: Sequence[DriveState],
        statuswords: Sequence[int],
        current: Vector,
        fresh: NDArray[np.bool_],
    ) -> list[int]:
        """Joints whose drives ignore their setpoints, from the fresh samples of one tick; current
        (n,) [A]."""
        if all(word & FOLLOWS for word in statuswords):  # -1, for none, is not a state in operation
            self._known = [True] * len(self._known)
            self._ticks = [0] * len(self._ticks)
            return []
        limited = (np.abs(current) >= self._limited).tolist()
        for i, (state, word) in enumerate(zip(states, statuswords, strict=True)):
            operating = state is DriveState.OPERATION_ENABLED
            if not fresh[i]:
                continue
            if operating and word & FOLLOWS:
                self._known[i], self._ticks[i] = True, 0
            elif operating and self._known[i] and not limited[i]:
                self._ticks[i] += 1
            else:
                self._ticks[i] = 0
        return [i for i, ticks in enumerate(self._ticks) if ticks >= IGNORED_TICKS]
