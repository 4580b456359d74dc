"""Loss of supply: the power stage of a drive has lost its voltage. Pure.

A drive may report whether its power stage has voltage, in any condition. Not every drive does:
missing voltage counts only if the drive has reported voltage before in the same state, powered or
not.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.api import DriveStatus

#: Consecutive samples without voltage until it is a loss: a dip of the supply is not.
GONE_TICKS: Final = 2


class Supply:
    """Monitor of the supply of n drives; `step` once per tick."""

    def __init__(self, n: int) -> None:
        self._n = n
        self.restart()

    def restart(self) -> None:
        """Forget which drives report voltage: the drives may have been exchanged."""
        self._drives: tuple[DriveStatus, ...] = ()
        self._known: list[set[bool]] = [set() for _ in range(self._n)]  # powered or not
        self._ticks = [0] * self._n

    def step(self, drives: tuple[DriveStatus, ...], fresh: NDArray[np.bool_]) -> None:
        """Process the fresh samples of one tick."""
        if drives == self._drives and not any(self._ticks):
            return
        for i, drive in enumerate(drives):
            if drive.supplied is None or not fresh[i]:
                continue
            powered = drive.condition.powered
            if drive.supplied:
                self._known[i].add(powered)
                self._ticks[i] = 0
            else:
                self._ticks[i] = self._ticks[i] + 1 if powered in self._known[i] else 0
        self._drives = drives

    @property
    def doubted(self) -> bool:
        """True while the supply of any drive is missing."""
        return any(self._ticks)

    def missing(self, joint: int) -> bool:
        """True if the drive's last fresh report shows no voltage, and an earlier one showed it."""
        return self._ticks[joint] > 0

    def lost(self, joint: int) -> bool:
        """True if the supply has been missing for GONE_TICKS."""
        return self._ticks[joint] >= GONE_TICKS
