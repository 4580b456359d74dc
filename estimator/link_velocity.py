# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Link velocity from sampled positions, and all other signals at the same instant.

A parabola through the last three positions gives position and velocity at any instant near them.
The methods differ in how far back that instant lies:

    backward   now:              second-order backward difference, no delay, most noise
    midpoint   half a period ago: mean velocity of the last interval
    central    one period ago:    central difference, least noise
    motor      half a period ago: motor velocity, for links whose position is the motor's, too

At equal intervals T and encoder noise s the velocity noise is 2.55, 1.41 and 0.71 times s / T.
Currents and motor velocities are interpolated to the same instant: with mixed instants every
acceleration would look like a torque.
"""

import numpy as np

from estimator.settings import EstimatorSettings, Method

DELAY_PERIODS: dict[Method, float] = {
    "backward": 0.0,
    "midpoint": 0.5,
    "central": 1.0,
    "motor": 0.5,
}
SAMPLES = 3
"""Positions needed for the first velocity."""
_SAMPLES = SAMPLES  # for the compiler
# Rows of `samples`, and of `aligned`.
_CURRENT, _MOTOR_VELOCITY, _MOTOR_POSITION, _LINK_POSITION, _INPUTS = range(5)
_Q, _Q_DOT, _ALIGNED_CURRENT, _THETA_DOT, _THETA, _ALIGNED = range(6)


class Alignment:
    """Last samples of each joint, and their values at one common instant.

    The caller writes `samples` (4, n): current, motor velocity, motor position, link position; and
    reads `aligned` (5, n): link position and velocity, current, motor velocity, motor position.
    Each signal is older than its sample by a transport delay of its own: of the drive's filter for
    the current, of the encoder for the link position.
    """

    def __init__(self, n: int, settings: EstimatorSettings, period_s: float) -> None:
        s = settings
        self._by_motor = s.link_velocity == "motor"
        self._back = DELAY_PERIODS[s.link_velocity] * period_s
        self.delay_s = self._back + s.link_position_delay_ms / 1000
        """Time from the common instant to the arrival of the newest samples [s]."""
        self._current_age = self.delay_s - s.current_delay_ms / 1000
        self._velocity_age = self.delay_s - s.motor_velocity_delay_ms / 1000
        self._position_age = self.delay_s - s.motor_position_delay_ms / 1000
        self._period = period_s
        self.samples, self.aligned = np.zeros((_INPUTS, n)), np.zeros((_ALIGNED, n))
        self.history = np.zeros((SAMPLES, _INPUTS, n))  # newest first
        self.count = np.zeros(n, dtype=np.int64)  # samples of each joint, at most SAMPLES
        # Last two intervals between samples of each joint [s].
        self.interval, self.interval_before = np.full((2, n), period_s)

    def push(self, i: int, dt: float) -> None:
        """Append the sample of joint i, dt [s] after the previous one."""
        for row in range(_INPUTS):
            for k in range(_SAMPLES - 1, 0, -1):
                self.history[k, row, i] = self.history[k - 1, row, i]
            self.history[0, row, i] = self.samples[row, i]
        self.interval_before[i], self.interval[i] = self.interval[i], dt
        if self.count[i] == 0:
            self._begin(i)
        self.count[i] = min(self.count[i] + 1, _SAMPLES)

    def _begin(self, i: int) -> None:
        """Extrapolate joint i backward from its first sample, as if its link followed its motor."""
        self.interval[i] = self.interval_before[i] = self._period
        for k in range(1, _SAMPLES):
            turned = k * self._period * self.samples[_MOTOR_VELOCITY, i]
            for row in range(_INPUTS):
                self.history[k, row, i] = self.samples[row, i]
                if row >= _MOTOR_POSITION:
                    self.history[k, row, i] -= turned

    def align(self, i: int) -> None:
        """Interpolate the samples of joint i at the common instant."""
        a = self.aligned
        # Newton's form of the parabola: slope of the last interval, and the curvature.
        h, before, back = self.interval[i], self.interval_before[i], self._back
        newest = self.history[0, _LINK_POSITION, i]
        second, third = self.history[1, _LINK_POSITION, i], self.history[2, _LINK_POSITION, i]
        slope = (newest - second) / h
        curvature = (slope - (second - third) / before) / (h + before)
        a[_Q, i] = newest - back * slope - back * (h - back) * curvature
        a[_Q_DOT, i] = slope + (h - 2.0 * back) * curvature
        a[_ALIGNED_CURRENT, i] = self._earlier(i, _CURRENT, self._current_age / h)
        a[_THETA_DOT, i] = self._earlier(i, _MOTOR_VELOCITY, self._velocity_age / h)
        a[_THETA, i] = self._earlier(i, _MOTOR_POSITION, self._position_age / h)
        if self._by_motor:
            a[_Q_DOT, i] = a[_THETA_DOT, i]

    def _earlier(self, i: int, row: int, share: float) -> float:
        """Value of a signal at this share of the last interval before its newest sample."""
        newest = self.history[0, row, i]
        return float(newest + (self.history[1, row, i] - newest) * share)

    def carry(self, i: int, dt: float) -> None:
        """Extrapolate joint i over dt [s] without a sample, at constant velocity and current."""
        self.aligned[_Q, i] += self.aligned[_Q_DOT, i] * dt
        self.aligned[_THETA, i] += self.aligned[_THETA_DOT, i] * dt

    def restart(self, i: int) -> None:
        """Forget all samples of joint i."""
        self.count[i] = 0
        for row in range(_INPUTS):
            for k in range(_SAMPLES):
                self.history[k, row, i] = 0.0
        for row in range(_ALIGNED):
            self.aligned[row, i] = 0.0
