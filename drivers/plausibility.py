"""Plausibility of a motor's positions: one that is further from the last than the motor can have
come counts once another, of a later tick, agrees with it. Where its velocity is the only witness
of them, both have to go the same way. Pure.

A frame may come from another motor, or be spoiled in an adapter; no setpoint may follow it.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final

#: After more ticks without a position [ticks] a motor may be anywhere.
RECENT: Final = 3
#: Share of the way between position and velocity that is kept from tick to tick, and ways in a tick
#: by which a velocity that is filtered may differ meanwhile.
KEPT: Final = 0.9
LAG_TICKS: Final = 2.0


class Plausibility:
    """Last positions of the motors of one arm, in any one unit of each."""

    def __init__(self, ways: Sequence[float]) -> None:
        """ways: furthest way of each motor in a tick, beside what it reports."""
        self._ways = tuple(ways)
        self._tick = 0
        self._nowhere = math.nan, 0
        self._taken = [self._nowhere] * len(ways)  # position and its tick
        self._doubted = [self._nowhere] * len(ways)
        self._apart = [(0.0, 0.0)] * len(ways)  # way by the velocity beyond that seen, speed
        self.jumped = [False] * len(ways)
        """Motors whose position changed by more than they can move, since it was forgotten."""

    def forget(self, joints: Iterable[int]) -> None:
        """Let the motors of these joints be anywhere."""
        for joint in joints:
            self._taken[joint] = self._doubted[joint] = self._nowhere
            self._apart[joint] = 0.0, 0.0
            self.jumped[joint] = False

    def begin_tick(self) -> None:
        """Begin a tick."""
        self._tick += 1

    def admits(self, joint: int, position: float, witness: float | None = None) -> bool:
        """True for a position where the motor of this joint may be; `witness`: its way in a tick by
        its velocity, None where that is not what bears its position out."""
        speed = witness or 0.0
        taken, doubted = self._taken[joint], self._doubted[joint]
        agrees = self._near(joint, position, speed, doubted)
        if self._near(joint, position, speed, taken) or (agrees and doubted[1] < self._tick):
            # So not for the first.
            self.jumped[joint] |= self._off(joint, position, speed, taken) > 0.0
            if witness is not None:
                self.jumped[joint] |= self._parts(joint, position, speed, taken)
            self._taken[joint], self._doubted[joint] = (position, self._tick), self._nowhere
            return True
        if not agrees:
            self._doubted[joint] = position, self._tick
        return False

    def _parts(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> bool:
        """True if velocity and position of a joint, followed over some ticks, part."""
        way, fast = self._apart[joint]
        ticks = self._tick - last[1]
        way = KEPT**ticks * way + speed * ticks - (position - last[0])
        if math.isnan(way) or ticks > RECENT:
            way = 0.0
        fast = max(KEPT * fast, abs(speed))
        self._apart[joint] = way, fast
        return abs(way) > self._ways[joint] + LAG_TICKS * fast

    def _near(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> bool:
        recent = self._tick - last[1] <= RECENT
        return recent and self._off(joint, position, speed, last) <= 0.0

    def _off(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> float:
        """Distance of a position beyond where its motor can be since a last one; NaN for none."""
        ticks = self._tick - last[1]
        most = self._ways[joint] * (ticks + 1) + abs(speed)
        return abs(position - last[0] - speed * ticks) - most
