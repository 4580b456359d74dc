# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Arrivals of samples: which joints have one in this tick, and how old those of the others are."""

import numpy as np

from estimator.estimate import SENSED_PERIODS, Flag
from estimator.link_velocity import SAMPLES, Alignment

_SAMPLES, _SENSED_PERIODS = SAMPLES, SENSED_PERIODS  # for the compiler
_LATE, _RESTARTED = int(Flag.LATE), int(Flag.RESTARTED)
_BRIDGED, _RAISED, _STARTING = int(Flag.BRIDGED), int(Flag.RAISED), int(Flag.STARTING)
# An interval of so many periods is late; one of so many raises the levels of its joint: two samples
# were missing.
_LATE_PERIODS, _RAISED_PERIODS = 1.5, 2.5
# Over a longer gap nothing is bridged [periods]: Tustin's rule does not know what happened in it.
_BRIDGED_PERIODS = 5.5


class Arrivals:
    """Those of an arm's joints. The caller writes `came` (n,), 1 where a joint has a sample."""

    def __init__(self, alignment: Alignment, n: int, period_s: float) -> None:
        self._alignment, self._n, self._period = alignment, n, period_s
        self.came = np.ones(n, dtype=np.int64)
        # Time since the sample of each joint that was used last, and between that and the one
        # before where it came in this tick, 0 where none did [s].
        self.since, self.gaps = np.zeros((2, n))

    def tick(self, dt: float) -> bool:
        """Pass dt [s]. Returns True if that and all samples that came are finite."""
        everything = dt
        for i in range(self._n):
            if self.came[i]:
                for row in range(4):
                    everything += self._alignment.samples[row, i]
        for i in range(self._n):
            self.since[i] += self.step(dt)
        return bool(everything - everything == 0.0 and dt > 0.0)

    def step(self, dt: float) -> float:
        """dt [s] where it is one, else the period."""
        return float(dt if dt > 0.0 and dt - dt == 0.0 else self._period)

    def gap(self, i: int) -> int:
        """Close the interval of joint i, if its sample came. Returns `Flag`s: with RESTARTED, too
        much is missing, and the joint has to start anew before the sample is pushed."""
        self.gaps[i] = 0.0
        if not self.came[i]:
            return _BRIDGED
        self.gaps[i], self.since[i] = self.since[i], 0.0
        flags = _LATE if self.late(i) else 0
        if self.gaps[i] > _BRIDGED_PERIODS * self._period and self._alignment.count[i] > 0:
            flags |= _RESTARTED
        return flags

    def starting(self) -> int:
        """STARTING while no joint has samples enough, or one has none; else 0."""
        ready, counted = False, True
        for i in range(self._n):
            ready = ready or self._alignment.count[i] >= _SAMPLES
            counted = counted and self._alignment.count[i] > 0
        return 0 if ready and counted else _STARTING

    def late(self, i: int) -> bool:
        """True where the interval of joint i that ends now is a late one."""
        return bool(self.gaps[i] > _LATE_PERIODS * self._period)

    def raised(self, i: int) -> int:
        """RAISED where samples were missing in the interval of joint i that ends now; else 0."""
        return _RAISED if self.gaps[i] > _RAISED_PERIODS * self._period else 0

    def bridged(self, i: int) -> bool:
        """True while joint i, without a sample, is still taken to go on as it did."""
        return bool(self.since[i] <= _BRIDGED_PERIODS * self._period)

    def senses(self, i: int) -> bool:
        """True while the last sample of joint i is young enough for its residual to count."""
        return bool(self.since[i] <= _SENSED_PERIODS * self._period)
