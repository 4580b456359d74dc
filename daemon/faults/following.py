"""Following check: does each motor follow its setpoints? Pure; arrays of shape (n,), SI at the link
side.

A drive may send samples but receive no setpoint: it continues at the last velocity received. Its
motor then deviates from its setpoint, and its current does not counteract this. A motor that is
blocked, or driven externally, deviates too, but its drive pushes towards the setpoint. So does one
whose link sagged as its brake opened, while its drive's integral takes up the weight: for a while
after enabling, a current that changes in the right direction is enough (decision 0011).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.faults.measures import within

#: A motor must deviate for this many consecutive ticks.
TICKS: Final = 20
#: Current towards the setpoint, as a share of its limit, from which on a drive counts as following.
PRESSING_SHARE: Final = 0.5
#: Ticks after enabling in which a current that changes in the right direction may take up weight.
SAG_TICKS: Final = 50
#: Smallest such change of current since enabling, as a share of its limit.
HEARD_SHARE: Final = 0.02
#: Change of current, as a share of its limit, from which on its right direction is reported.
PRESSED_SHARE: Final = 0.005
#: Ticks from a setpoint until the samples of a drive without any lag show all of it: latched at the
#: next SYNC, interpolated until the one after, and sampled there.
LATENCY_TICKS: Final = 3


@dataclass(frozen=True, slots=True)
class FollowingSettings:
    """Bounds of each joint, arrays of shape (n,)."""

    deviation: Vector  # of the motor's velocity from its setpoints [rad/s]
    current: Vector  # the drives' limit [A]
    lag_s: float  # time constant of the drives' velocity loops


class Following:
    """Comparison of velocities with all setpoints that a motor may still be following."""

    def __init__(self, settings: FollowingSettings, period_s: float) -> None:
        self._settings = settings
        self._pressing = PRESSING_SHARE * settings.current
        self._heard = HEARD_SHARE * settings.current
        n = len(settings.current)
        ticks = LATENCY_TICKS + math.ceil(3.0 * settings.lag_s / period_s)
        self._setpoints = np.zeros((ticks, n))
        self._next = 0
        self._in_row = np.zeros(n, dtype=np.int64)
        self._too_slow, self._too_fast = np.zeros((2, n), dtype=np.bool_)
        self._off, self._first, self._begun, self._current = np.zeros((4, n))
        self._since = 0  # ticks since enabling

    def restart(self) -> None:
        """Reset the setpoints to zero: the motors are commanded to stand."""
        self._setpoints.fill(0.0)
        self._in_row.fill(0)
        self._since = 0

    def record(self, setpoint: Vector) -> None:
        """Store the setpoints of the previous tick (n,) [rad/s]."""
        self._setpoints[self._next] = setpoint
        self._next = (self._next + 1) % len(self._setpoints)
        self._since += 1

    def not_following(
        self, velocity: Vector, current: Vector, fresh: NDArray[np.bool_]
    ) -> list[int]:
        """Joints whose drives do not follow, from the fresh samples of motor velocity [rad/s] and
        current [A]."""
        deviation = self._settings.deviation
        if self._since <= 1:
            self._first[:] = current
        obeyed = within(velocity, self._setpoints[self._next - 1], deviation)
        if obeyed and all(fresh.tolist()):
            # All follow the last setpoint: in the usual tick no other one is needed.
            self._in_row.fill(0)
            return []
        slower = self._setpoints.min(axis=0) - velocity
        faster = velocity - self._setpoints.max(axis=0)
        np.maximum(slower, faster, out=self._off)
        np.logical_and(slower > deviation, current < self._pressing, out=self._too_slow)
        np.logical_and(faster > deviation, current > -self._pressing, out=self._too_fast)
        if self._since <= SAG_TICKS:
            # If the first current is not a number, nothing is excused.
            self._too_slow &= ~(current >= self._first + self._heard)
            self._too_fast &= ~(current <= self._first - self._heard)
        self._current[:] = current
        np.copyto(self._begun, current, where=self._in_row == 0)
        self._in_row += fresh
        self._in_row *= self._too_slow | self._too_fast | ~fresh
        return np.flatnonzero(self._in_row >= TICKS).tolist()

    def figures(self, joint: int) -> str:
        """Deviation of a joint from the nearest of its setpoints and its bound, as text; and, if
        so, that its current went the right way, as it does not without setpoints."""
        off = f"by {self._off[joint]:.3f} rad/s, at most {self._settings.deviation[joint]:.3f}"
        pressed = float(self._current[joint] - self._begun[joint]) / self._settings.current[joint]
        pressed *= 1.0 if self._too_slow[joint] else -1.0
        obeys = (f"{off}; its current went the right way by {pressed:.1%} of its limit: it obeys, "
                 "but friction or a push is stronger, or its velocity loop is soft")  # fmt: skip
        return obeys if pressed >= PRESSED_SHARE else off
