"""Plausibility of a motor's positions: one that is further from the last than the motor can have
come counts once another, of a later tick, agrees with it. Pure.

A frame may come from another motor, or be spoiled in an adapter; no setpoint may follow it.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final

#: After more ticks without a position [ticks] a motor may be anywhere.
RECENT: Final = 3


class Plausibility:
    """Last positions of the motors of one arm, in any one unit of each."""

    def __init__(self, ways: Sequence[float]) -> None:
        """ways: furthest way of each motor in a tick, beside what it reports."""
        self._ways = tuple(ways)
        self._tick = 0
        self._nowhere = math.nan, 0
        self._taken = [self._nowhere] * len(ways)  # position and its tick
        self._doubted = [self._nowhere] * len(ways)
        self.jumped = [False] * len(ways)
        """Motors whose position changed by more than they can move, since it was forgotten."""

    def forget(self, joints: Iterable[int]) -> None:
        """Let the motors of these joints be anywhere."""
        for joint in joints:
            self._taken[joint] = self._doubted[joint] = self._nowhere
            self.jumped[joint] = False

    def begin_tick(self) -> None:
        """Begin a tick."""
        self._tick += 1

    def admits(self, joint: int, position: float, speed: float = 0.0) -> bool:
        """True for a position where the motor of this joint may be; `speed`: its way in a tick, as
        it reports it."""
        taken, doubted = self._taken[joint], self._doubted[joint]
        agrees = self._near(joint, position, speed, doubted)
        if self._near(joint, position, speed, taken) or (agrees and doubted[1] < self._tick):
            # So not for the first.
            self.jumped[joint] |= self._off(joint, position, speed, taken) > 0.0
            self._taken[joint], self._doubted[joint] = (position, self._tick), self._nowhere
            return True
        if not agrees:
            self._doubted[joint] = position, self._tick
        return False

    def _near(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> bool:
        recent = self._tick - last[1] <= RECENT
        return recent and self._off(joint, position, speed, last) <= 0.0

    def _off(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> float:
        """Distance of a position beyond where its motor can be since a last one; NaN for none."""
        ticks = self._tick - last[1]
        most = self._ways[joint] * (ticks + 1) + abs(speed)
        return abs(position - last[0] - speed * ticks) - most
