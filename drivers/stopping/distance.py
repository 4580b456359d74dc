"""Distance travelled by a drive since its stop command, and whether it drove or was driven. Pure.

SI units at the link; NaN means no reading.
"""

import math
from typing import Final

from drivers.stopping.witness import MOVES

#: Time in which a driven path as long as the whole travel is forgotten [s].
FORGETS_S: Final = 60.0
#: A drive that was moved against its power by more than this share of its travel is pushed.
PUSHED_SHARE: Final = 0.1


class Distance:
    """Distance of one drive from where it was commanded to stop."""

    gone: float
    """Distance by the sensor that shows the largest, as a constant reading proves nothing; for a
    joint that falls, by its positions only [rad]."""
    driven: float
    """Path under its own power minus path against it; negative only if it resisted [rad]."""
    velocity: float
    """Last known velocity [rad/s]."""
    _from: tuple[float, float]  # link and motor position at the stop command [rad]
    _last: tuple[float, float]  # link and motor position of the last reading [rad]
    _integrated: float  # integral of the velocity where it exceeds a bias [rad]

    def __init__(self, travel: float, *, falls: bool = False) -> None:
        """travel: permitted distance of its joint [rad]; falls: the joint falls without power, so
        that a velocity counts only as far as a position confirms it."""
        self._travel, self._falls = travel, falls
        self.begin(math.nan, math.nan, math.nan)

    def begin(self, link: float, motor: float, velocity: float) -> None:
        """Begin at these link and motor positions [rad] with this velocity [rad/s]."""
        self._from = self._last = link, motor
        self._integrated = self.gone = self.driven = 0.0
        self.velocity = 0.0 if math.isnan(velocity) else velocity

    @property
    def speed(self) -> float:
        """Last known speed [rad/s]."""
        return abs(self.velocity)

    @property
    def pushed(self) -> bool:
        """True if, on balance, it was moved against its own torque."""
        return self.driven < -PUSHED_SHARE * self._travel

    def coast(self, dt: float, deceleration: float) -> None:
        """Extrapolate without a reading for `dt` [s], at this deceleration [rad/s2]."""
        self.velocity = math.copysign(max(self.speed - deceleration * dt, 0.0), self.velocity)
        self._integrated += self.velocity * dt
        self.gone += self.speed * dt

    def take(
        self, dt: float, velocity: float, current: float, positions: tuple[float, float],
        *, resists: bool,
    ) -> None:  # fmt: skip
        """Take a reading `dt` [s] after the last: velocity [rad/s], current [A], link and motor
        position [rad]; resists: it brakes near its current limit."""
        self.velocity = velocity
        path = self.speed * dt
        if self._falls:
            path = min(path, _largest(_difference(positions, self._last)))
        self._last = positions
        forgotten = min(abs(self.driven), self._travel / FORGETS_S * dt)
        self.driven -= math.copysign(forgotten, self.driven)
        if self.speed >= MOVES:
            self._integrated += velocity * dt
            if abs(power := current * velocity) > 0.0:  # nor NaN
                least = -self._travel if resists else min(self.driven, 0.0)
                self.driven = max(self.driven + math.copysign(path, power), least)
        shown = _largest(_difference(positions, self._from))
        self.gone = shown if self._falls else max(shown, abs(self._integrated))


def _difference(positions: tuple[float, float], others: tuple[float, float]) -> tuple[float, float]:
    return positions[0] - others[0], positions[1] - others[1]


def _largest(distances: tuple[float, float]) -> float:
    """Largest of the known distances [rad]; 0 if none is known."""
    return max((abs(each) for each in distances if not math.isnan(each)), default=0.0)
