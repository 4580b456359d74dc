"""Ignored setpoints: a drive in operation reports not following its target velocity. Pure.

A drive may report that it follows its target velocity. The report ends when another tool selects
another mode of operation. It may also end at the current limit, which is not this fault. Not every
drive has this report: one that has never made it is not checked.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from drivers.api import DriveCondition, DriveStatus

#: Ticks without the report until a finding: on entering operation a drive may make it with a delay.
IGNORED_TICKS: Final = 3
#: Share of its current limit from which on a drive may be saturated rather than in another mode.
LIMITED_SHARE: Final = 0.5


class IgnoredSetpoints:
    """Monitor of this report from all drives of an arm."""

    def __init__(self, current_limit: Vector) -> None:
        """current_limit: (n,) [A]."""
        self._limited = LIMITED_SHARE * current_limit
        n = len(current_limit)
        self._known = [False] * n  # drives that have made the report
        self._ticks = [0] * n

    def restart(self) -> None:
        """Forget which drives make the report: the drives may have been exchanged."""
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
