"""Plausibility of motor positions. Pure.

A position further from the last one than the motor can have moved is accepted only once another, of
a later tick, agrees with it. Where the motor's velocity is the only evidence for its positions, its
integral must agree with them, too. A frame may come from another motor or be corrupted in an
adapter; no setpoint may be derived from it.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final

#: Age up to which a position constrains the next one [ticks].
RECENT: Final = 3
#: Decay per tick of the discrepancy between position and integrated velocity, and the lag of a
#: filtered velocity that is tolerated [ticks].
KEPT: Final = 0.9
LAG_TICKS: Final = 2.0


class Plausibility:
    """Last positions of the motors of one arm, each in one consistent unit."""

    def __init__(self, ways: Sequence[float]) -> None:
        """ways: longest travel of each motor in a tick, beyond that by its reported velocity."""
        self._reach = tuple(ways)
        self._tick = 0
        self._nowhere = math.nan, 0
        self._taken = [self._nowhere] * len(ways)  # accepted position and its tick
        self._doubted = [self._nowhere] * len(ways)  # rejected position and its tick
        self._discrepancy = [(0.0, 0.0)] * len(ways)  # integrated velocity minus travel, peak speed
        self.jumped = [False] * len(ways)
        """Motors whose position jumped further than they can move, since it was last forgotten."""

    def forget(self, joints: Iterable[int]) -> None:
        """Accept any next position of the motors of these joints."""
        for joint in joints:
            self._taken[joint] = self._doubted[joint] = self._nowhere
            self._discrepancy[joint] = 0.0, 0.0
            self.jumped[joint] = False

    def begin_tick(self) -> None:
        """Begin a tick."""
        self._tick += 1

    def admits(self, joint: int, position: float, witness: float | None = None) -> bool:
        """True if a position is plausible for the motor of this joint. `witness`: its travel per
        tick by its velocity; None if velocity is not the evidence for its position."""
        speed = witness or 0.0
        taken, doubted = self._taken[joint], self._doubted[joint]
        agrees = self._near(joint, position, speed, doubted)
        if self._near(joint, position, speed, taken) or (agrees and doubted[1] < self._tick):
            # The distance from no position is NaN: the first one is no jump.
            self.jumped[joint] |= self._excess(joint, position, speed, taken) > 0.0
            if witness is not None:
                self.jumped[joint] |= self._diverges(joint, position, speed, taken)
            self._taken[joint], self._doubted[joint] = (position, self._tick), self._nowhere
            return True
        if not agrees:
            self._doubted[joint] = position, self._tick
        return False

    def _diverges(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> bool:
        """True if velocity and position of a joint, followed over some ticks, diverge."""
        drift, peak = self._discrepancy[joint]
        ticks = self._tick - last[1]
        drift = KEPT**ticks * drift + speed * ticks - (position - last[0])
        if math.isnan(drift) or ticks > RECENT:
            drift = 0.0
        peak = max(KEPT * peak, abs(speed))
        self._discrepancy[joint] = drift, peak
        return abs(drift) > self._reach[joint] + LAG_TICKS * peak

    def _near(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> bool:
        recent = self._tick - last[1] <= RECENT
        return recent and self._excess(joint, position, speed, last) <= 0.0

    def _excess(self, joint: int, position: float, speed: float, last: tuple[float, int]) -> float:
        """Distance of a position beyond the motor's reach since the last one; NaN without one."""
        ticks = self._tick - last[1]
        most = self._reach[joint] * (ticks + 1) + abs(speed)
        return abs(position - last[0] - speed * ticks) - most
