"""Distance that a drive has gone since it was commanded to stop, and by whose power. Pure.

All at the link, SI; NaN is no reading.
"""

import math
from typing import Final

from drivers.stopping.witness import MOVES

#: Time in which the path by its own power is forgotten, were it all of its travel [s].
FORGETS_S: Final = 60.0
#: A drive that was moved so much of its travel against its power is pushed.
PUSHED_SHARE: Final = 0.1


class Distance:
    """Distance of one drive from where it was commanded to stop."""

    gone: float
    """By the sensor that shows the most: one that stands still proves nothing; of a joint that
    falls, by its positions [rad]."""
    driven: float
    """Path by its own power, less that against it; below 0 only where it resisted [rad]."""
    velocity: float
    """Velocity that was last known [rad/s]."""
    _from: tuple[float, float]  # positions of link and motor [rad]
    _last: tuple[float, float]  # those of the last reading
    _turned: float  # integral of its velocity, as far as it is more than bias [rad]

    def __init__(self, travel: float, *, falls: bool = False) -> None:
        """travel: how far its joint may go [rad]; falls: it does so without power, so that a
        velocity counts as far as a position bears it out."""
        self._travel, self._falls = travel, falls
        self.begin(math.nan, math.nan, math.nan)

    def begin(self, link: float, motor: float, velocity: float) -> None:
        """Begin at these positions [rad] with this velocity [rad/s]."""
        self._from = self._last = link, motor
        self._turned = self.gone = self.driven = 0.0
        self.velocity = 0.0 if math.isnan(velocity) else velocity

    @property
    def speed(self) -> float:
        """Size of the velocity that was last known [rad/s]."""
        return abs(self.velocity)

    @property
    def pushed(self) -> bool:
        """True if in all a force moved it that was stronger than what it gave."""
        return self.driven < -PUSHED_SHARE * self._travel

    def coast(self, dt: float, deceleration: float) -> None:
        """Go on unseen for `dt` [s], slowing down [rad/s2]."""
        self.velocity = math.copysign(max(self.speed - deceleration * dt, 0.0), self.velocity)
        self._turned += self.velocity * dt
        self.gone += self.speed * dt

    def take(
        self, dt: float, velocity: float, current: float, positions: tuple[float, float],
        *, resists: bool,
    ) -> None:  # fmt: skip
        """Take a reading `dt` [s] after the last: velocity [rad/s], current [A], positions of link
        and motor [rad]; resists: it brakes as it can."""
        self.velocity = velocity
        way = self.speed * dt
        if self._falls:
            way = min(way, _furthest(_apart(positions, self._last)))
        self._last = positions
        forgotten = min(abs(self.driven), self._travel / FORGETS_S * dt)
        self.driven -= math.copysign(forgotten, self.driven)
        if self.speed >= MOVES:
            self._turned += velocity * dt
            if abs(power := current * velocity) > 0.0:  # nor NaN
                least = -self._travel if resists else min(self.driven, 0.0)
                self.driven = max(self.driven + math.copysign(way, power), least)
        shown = _furthest(_apart(positions, self._from))
        self.gone = shown if self._falls else max(shown, abs(self._turned))


def _apart(positions: tuple[float, float], others: tuple[float, float]) -> tuple[float, float]:
    return positions[0] - others[0], positions[1] - others[1]


def _furthest(ways: tuple[float, float]) -> float:
    """Furthest of the ways that are known [rad]; 0 where none is."""
    return max((abs(way) for way in ways if not math.isnan(way)), default=0.0)
