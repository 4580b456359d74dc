"""Loss of supply: the power stage of a drive has no voltage any more. Pure.

Bit 4 of the statusword, voltage enabled, means that the power stage is supplied (CiA 402-2), in any
state of the drive. Not every drive implements it so: each is judged only by bits it has set before,
in operation by the bit in operation, without power by the bit without power.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.canopen.cia402 import UNPOWERED, DriveState

#: "Voltage enabled" of the statusword.
VOLTAGE_ENABLED: Final = 1 << 4
#: Samples in a row in which it must be clear: a dip of the supply is not a loss.
GONE_TICKS: Final = 2


class Supply:
    """Monitor of that bit of n drives; `step` once per tick."""

    def __init__(self, n: int) -> None:
        self._n = n
        self.restart()

    def restart(self) -> None:
        """Forget which drives have the bit: the drives may be others now."""
        self._words: tuple[int, ...] = ()
        self._known: list[set[bool]] = [set() for _ in range(self._n)]  # set with power, without
        self._ticks = [0] * self._n

    def step(
        self,
        states: Sequence[DriveState],
        statuswords: tuple[int, ...],
        fresh: NDArray[np.bool_],
    ) -> None:
        """Process the fresh samples of one tick."""
        if statuswords == self._words and not any(self._ticks):
            return
        for i, (state, word) in enumerate(zip(states, statuswords, strict=True)):
            if word < 0 or not fresh[i]:
                continue
            powered = state not in UNPOWERED
            if word & VOLTAGE_ENABLED:
                self._known[i].add(powered)
                self._ticks[i] = 0
            else:
                self._ticks[i] = self._ticks[i] + 1 if powered in self._known[i] else 0
        self._words = statuswords

    @property
    def doubted(self) -> bool:
        """True while the bit of any drive is missing."""
        return any(self._ticks)

    def missing(self, joint: int) -> bool:
        """True if the drive's last fresh statusword is without the bit, and had it before."""
        return self._ticks[joint] > 0

    def lost(self, joint: int) -> bool:
        """True if the bit has been missing for long enough."""
        return self._ticks[joint] >= GONE_TICKS
