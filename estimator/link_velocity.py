"""Link velocity from sampled positions, and everything else sampled at the same instant.

A parabola through the last three positions gives position and velocity at any instant near them.
How far back that instant lies is the method:

    backward   now:              second-order backward difference, no delay, most noise
    midpoint   half a period ago: mean velocity of the last interval
    central    one period ago:    central difference, least noise

For samples of equal distance T and encoder noise s the noise of the velocity is 2.55, 1.41 and
0.71 times s / T. Currents and motor velocities are interpolated to the same instant: mixing times
turns every acceleration into a torque that is not there.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator import memory

Method = Literal["backward", "midpoint", "central"]
DELAY_PERIODS: dict[Method, float] = {"backward": 0.0, "midpoint": 0.5, "central": 1.0}

SAMPLES = 3
"""Positions needed before the first velocity."""


def parabola(last_interval: Vector, interval_before: Vector, delay: float) -> NDArray[np.float64]:
    """Weights (2, 3, n) that give position and velocity `delay` seconds before the newest sample.

    Times positions (3, n), newest first; the intervals (n,) [s] between them may differ.
    """
    h, whole = last_interval, last_interval + interval_before
    # Newton's form: slope of the last interval, and the curvature that bends it.
    bend = 1.0 / (h * whole), -1.0 / (h * interval_before), 1.0 / (interval_before * whole)
    x, v = -delay * (h - delay), h - 2.0 * delay
    return np.array(
        [
            [1.0 - delay / h + x * bend[0], delay / h + x * bend[1], x * bend[2]],
            [1.0 / h + v * bend[0], -1.0 / h + v * bend[1], v * bend[2]],
        ]
    )


ALIGNED = ("link_position", "link_velocity", "current", "motor_velocity", "motor_position")
"""Rows of what `Alignment.aligned` gives."""


class Alignment:
    """The last samples, and their values at one common instant `delay` seconds ago.

    A joint whose sample is missing goes on at its last velocity, with its last current. Each signal
    is older than its sample by a transport delay of its own [s]: the current by its drive's filter,
    the link position by its encoder's latency.
    """

    _MEMORY = ("count", "interval", "interval_before", "history")

    def __init__(
        self,
        n: int,
        method: Method,
        period: float,
        *,
        current_delay: float,
        link_delay: float,
        velocity_delay: float,
        position_delay: float,
    ) -> None:
        self._back = DELAY_PERIODS[method] * period
        self.delay = self._back + link_delay
        """The common instant lies this long before the newest sample arrived [s]."""
        self._current_age = self.delay - current_delay
        # Of the motor.
        self._velocity_age = self.delay - velocity_delay
        self._position_age = self.delay - position_delay
        self.count = np.zeros(n, dtype=np.int64)  # samples of each joint, at most SAMPLES
        self._period = period
        # Between the last samples of each joint [s].
        self.interval = np.full(n, period)
        self.interval_before = np.full(n, period)
        # Rows of a sample: current, motor velocity, motor position, link position; newest first.
        self.history: Matrix = np.zeros((SAMPLES * 4, n))
        self._ages = np.array([self._current_age, self._velocity_age, self._position_age])[:, None]

    @property
    def ready(self) -> NDArray[np.bool_]:
        """Joints (n,) whose link velocity is made of samples alone."""
        ready: NDArray[np.bool_] = self.count >= SAMPLES
        return ready

    def push(self, samples: Matrix, dt: Vector) -> None:
        """Take the samples of this tick, dt (n,) [s] after those before; 0 where there is none.

        samples: shape (4, n): current, motor velocity, motor position, link position.
        """
        came = dt > 0.0
        np.copyto(self.history[4:], self.history[:-4].copy(), where=came)
        np.copyto(self.history[:4], samples, where=came)
        np.copyto(self.interval_before, self.interval, where=came)
        np.copyto(self.interval, dt, where=came)
        first = came & (self.count == 0)
        if first.any():
            self._start(first)
        self.count += came
        np.minimum(self.count, SAMPLES, out=self.count)

    def _start(self, joints: NDArray[np.bool_]) -> None:
        """What was before the first samples of these joints (n,): as if their links had moved with
        their motors."""
        current, motor_velocity, motor_position, link = self.history[:4, joints]
        for ticks in range(1, SAMPLES):
            turned = ticks * self._period * motor_velocity
            rows = (current, motor_velocity, motor_position - turned, link - turned)
            self.history[4 * ticks : 4 * ticks + 4, joints] = rows
        self.interval[joints] = self.interval_before[joints] = self._period

    def aligned(
        self, out: Matrix, carried: Vector | None = None, absent: NDArray[np.bool_] | None = None
    ) -> None:
        """The rows of ALIGNED at the common instant into out (5, n).

        absent: joints (n,) without a sample in this tick; their values in `out`, of the tick
        before, are carried on for the time `carried` (n,) [s].
        """
        kept = None if absent is None else out[:, absent]
        weights = parabola(self.interval, self.interval_before, self._back)
        np.sum(weights * self.history[3::4], axis=1, out=out[:2])
        newest, before = self.history[:3], self.history[4:7]
        np.subtract(before, newest, out=out[2:])
        out[2:] *= self._ages / self.interval
        out[2:] += newest
        if absent is not None and kept is not None and carried is not None:
            kept[0] += kept[1] * carried[absent]
            kept[4] += kept[3] * carried[absent]
            out[:, absent] = kept

    def restart(self, joints: NDArray[np.bool_]) -> None:
        """Forget all samples of these joints (n,)."""
        self.count[joints] = 0
        self.history[:, joints] = 0.0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
