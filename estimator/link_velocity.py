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

from arrays import Matrix
from estimator import memory

Method = Literal["backward", "midpoint", "central"]
DELAY_PERIODS: dict[Method, float] = {"backward": 0.0, "midpoint": 0.5, "central": 1.0}

SAMPLES = 3
"""Positions needed before the first velocity."""


def parabola(last_interval: float, interval_before: float, delay: float) -> Matrix:
    """Weights (2, 3) that give position and velocity `delay` seconds before the newest sample.

    Times positions (3, n), newest first; the intervals [s] between them may differ.
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

    Each signal is older than its sample by a transport delay of its own [s]: the current by its
    drive's filter, the link position by its encoder's latency.
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
        self.count = 0
        self.interval = period
        self.interval_before = period
        # Rows of a sample: current, motor velocity, motor position, link position; newest first.
        self.history: Matrix = np.zeros((SAMPLES * 4, n))
        # All that is aligned is linear in all that was sampled.
        self._weights: Matrix = np.zeros((len(ALIGNED), SAMPLES * 4))

    @property
    def ready(self) -> bool:
        return self.count >= SAMPLES

    def push(self, samples: Matrix, dt: float) -> None:
        """Take the samples of this tick, dt seconds after those before.

        samples: shape (4, n): current, motor velocity, motor position, link position.
        """
        self.history[4:] = self.history[:-4]
        self.history[:4] = samples
        self.interval_before, self.interval = self.interval, dt
        self.count = min(self.count + 1, SAMPLES)

    def aligned(self, out: Matrix) -> None:
        """The rows of ALIGNED at the common instant into out (5, n)."""
        weights = self._weights
        weights[:2, 3::4] = parabola(self.interval, self.interval_before, self._back)
        ages = (self._current_age, self._velocity_age, self._position_age)
        for row, age in enumerate(ages):
            share = age / self.interval
            weights[2 + row, row], weights[2 + row, 4 + row] = 1.0 - share, share
        np.dot(weights, self.history, out=out)

    def restart(self) -> None:
        """Forget all samples."""
        self.count = 0

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
