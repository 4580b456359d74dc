"""Ignored setpoints: a drive in operation reports not following its target velocity. Pure.

A drive may report that it follows its target velocity. It no longer does when another tool selects
another mode of operation. A drive at its current limit may not report it either, which is not a
fault of this kind. Not every drive reports it: one that never has is not judged by it.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from drivers.api import DriveCondition, DriveStatus

#: Ticks for which it must be missing: on entering operation a drive may report it with a delay.
IGNORED_TICKS: Final = 3
#: A drive that gives this share of its current limit may be limited rather than in another mode.
LIMITED_SHARE: Final = 0.5


class IgnoredSetpoints:
    """Monitor of that report of every drive of an arm."""

    def __init__(self, current_limit: Vector) -> None:
        """current_limit: (n,) [A]."""
        self._limited = LIMITED_SHARE * current_limit
        n = len(current_limit)
        self._known = [False] * n  # it has reported it
        self._ticks = [0] * n

    def restart(self) -> None:
        """Forget which drives report it: the drives may be others now."""
        self._known = [False] * len(self._known)
        self._ticks = [0] * len(self._ticks)

    def joints(
        self, drives: Sequence[DriveStatus], current: Vector, fresh: NDArray[np.bool_]
    ) -> list[int]:
        """Joints whose drives ignore their setpoints, from the fresh samples of one tick; current
        (n,) [A]."""
        if all(drive.following for drive in drives):
            self._known = [True] * len(self._known)
            self._ticks = [0] * len(self._ticks)
            return []
        limited = (np.abs(current) >= self._limited).tolist()
        for i, drive in enumerate(drives):
            operating = drive.condition is DriveCondition.OPERATING
            if not fresh[i]:
                continue
            if operating and drive.following:
                self._known[i], self._ticks[i] = True, 0
            elif operating and self._known[i] and not limited[i]:
                self._ticks[i] += 1
            else:
                self._ticks[i] = 0
        return [i for i, ticks in enumerate(self._ticks) if ticks >= IGNORED_TICKS]
