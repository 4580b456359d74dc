# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Arrivals of samples: which joints have one in this tick, and the age of the last ones."""

import numpy as np

from estimator.estimate import SENSED_PERIODS, Flag
from estimator.link_velocity import SAMPLES, Alignment

_SAMPLES, _SENSED_PERIODS = SAMPLES, SENSED_PERIODS  # for the compiler
_LATE, _RESTARTED = int(Flag.LATE), int(Flag.RESTARTED)
_BRIDGED, _RAISED, _STARTING = int(Flag.BRIDGED), int(Flag.RAISED), int(Flag.STARTING)
# Lengths of an interval from which on it is late, and from which on it raises the levels of its
# joint (two samples missing) [periods].
_LATE_PERIODS, _RAISED_PERIODS = 1.5, 2.5
# Longest gap that is bridged [periods]: Tustin's rule neglects what happens within an interval.
_BRIDGED_PERIODS = 5.5


class Arrivals:
    """Sample arrivals of all joints. The caller writes `arrived` (n,): 1 for a joint with one."""

    def __init__(self, alignment: Alignment, n: int, period_s: float) -> None:
        self._alignment, self._n, self._period = alignment, n, period_s
        self.arrived = np.ones(n, dtype=np.int64)
        # Age of the last sample used of each joint, and length of the interval that a new sample
        # ends, 0 without one [s].
        self.since, self.gaps = np.zeros((2, n))

    def tick(self, dt: float) -> bool:
        """Advance by dt [s]. Returns True if dt and all new samples are finite, and dt positive."""
        everything = dt
        for i in range(self._n):
            if self.arrived[i]:
                for row in range(4):
                    everything += self._alignment.samples[row, i]
        for i in range(self._n):
            self.since[i] += self.step(dt)
        return bool(everything - everything == 0.0 and dt > 0.0)

    def step(self, dt: float) -> float:
        """dt [s] if it is valid, else the period."""
        return float(dt if dt > 0.0 and dt - dt == 0.0 else self._period)

    def gap(self, i: int) -> int:
        """Close the interval of joint i if its sample arrived. Returns `Flag`s; RESTARTED: too many
        samples are missing, and the joint must restart before the sample is pushed."""
        self.gaps[i] = 0.0
        if not self.arrived[i]:
            return _BRIDGED
        self.gaps[i], self.since[i] = self.since[i], 0.0
        flags = _LATE if self.late(i) else 0
        if self.gaps[i] > _BRIDGED_PERIODS * self._period and self._alignment.count[i] > 0:
            flags |= _RESTARTED
        return flags

    def starting(self) -> int:
        """STARTING until every joint has a sample, and one of them enough; else 0."""
        ready, counted = False, True
        for i in range(self._n):
            ready = ready or self._alignment.count[i] >= _SAMPLES
            counted = counted and self._alignment.count[i] > 0
        return 0 if ready and counted else _STARTING

    def late(self, i: int) -> bool:
        """True if the interval of joint i that ends now is late."""
        return bool(self.gaps[i] > _LATE_PERIODS * self._period)

    def raised(self, i: int) -> int:
        """RAISED if more than one sample was missing in the interval of joint i that ends now, or
        0."""
        return _RAISED if self.gaps[i] > _RAISED_PERIODS * self._period else 0

    def bridged(self, i: int) -> bool:
        """True while the motion of joint i may be extrapolated without a sample."""
        return bool(self.since[i] <= _BRIDGED_PERIODS * self._period)

    def senses(self, i: int) -> bool:
        """True while the last sample of joint i is recent enough for its residual to count."""
        return bool(self.since[i] <= _SENSED_PERIODS * self._period)
