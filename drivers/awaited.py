"""Answers awaited in a tick, and the age of each joint's samples. Pure.

The answers still awaited are bits of one integer. A joint is fresh if all of its answers arrived in
time; no joint is fresh if the first came so late that the time of measurement is unknown.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from drivers.promptness import Promptness
from drivers.punctuality import Punctuality

#: Longest time from a drive's start to its first answer [ticks].
START_TICKS = 30

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, slots=True)
class Freshness:
    """Freshness of all joints in one tick; arrays (n,) are read-only."""

    fresh: NDArray[np.bool_]
    age_s: Vector  # since the last fresh sample [s]
    starting: NDArray[np.bool_]  # not fresh since the start; the drive may still be starting up


class Awaited:
    """Awaited answers of an arm; `joint_bits` holds the bit mask of each joint's answers."""

    def __init__(self, joint_bits: Sequence[int], period_s: float) -> None:
        self._joint_bits, self._period_s = tuple(joint_bits), period_s
        self._all = sum(joint_bits)
        self.punctuality, self._promptness = Punctuality(period_s), Promptness(period_s)
        self.missing = 0
        """Bit mask of the answers still awaited."""
        self._asked = False  # in this tick
        self._asked_s: float | None = None  # None once the first answer has arrived
        self._prompt = True
        n = len(joint_bits)
        self._every = frozen(np.ones(n, dtype=np.bool_))
        self.none = self._starting = frozen(np.zeros(n, dtype=np.bool_))
        self._start_ticks = 0  # remaining ticks in which a drive may still be starting
        self._no_ticks = self._age_ticks = np.zeros(n, dtype=np.int64)
        self._no_age: Vector = frozen(np.zeros(n))
        self._age_s = self._no_age

    def start_anew(self) -> None:
        """Start over after a pause without requests: count ages from the next tick on, and do not
        count earlier frames as answers."""
        self._age_ticks, self._age_s = self._no_ticks, self._no_age
        self.missing, self._asked = 0, False
        self.punctuality.start_anew()
        self._start_ticks, self._starting = START_TICKS, self._every

    def expect_none(self) -> None:
        """Count every answer until the next request as unawaited."""
        self.missing = 0

    def expect_all(self, now: float, asked_s: float | None = None) -> None:
        """Await all answers: the request is about to be sent. asked_s: start of the tick on the
        clock of `left_s`; None if unknown."""
        self.punctuality.asked(now)
        self.missing, self._asked = self._all, True
        self._asked_s, self._prompt = asked_s, True

    def left_s(self, deadline: float, clock_s: float) -> float | None:
        """Time left for answers until `deadline` [s]; None once all have arrived. `clock_s` is the
        present time on the same clock."""
        if self._asked_s is not None and self.missing != self._all:
            self._prompt = self._promptness.step(clock_s - self._asked_s)
            self._asked_s = None
        return max(deadline - clock_s, 0.0) if self.missing else None

    def miss_all(self) -> None:
        """Count all answers of this tick as missing: they cannot be attributed to its request."""
        self.missing = self._all

    def joints_of(self, answers: int) -> list[int]:
        """Joints to which any of these answers belongs."""
        return [i for i, bits in enumerate(self._joint_bits) if bits & answers]

    def take(self, bit: int) -> bool:
        """Record an answer; False if it was not awaited."""
        if not self.missing & bit:
            return False
        self.missing ^= bit
        return True

    @property
    def freshness(self) -> Freshness:
        """Freshness before the first tick."""
        return Freshness(self.none, self._age_s, self._starting)

    def finish(self) -> Freshness:
        """End the tick and return its freshness."""
        missing, fresh = self.missing, self._every
        if self._asked:
            self.punctuality.ended(missing)
            self._asked = False
        if missing:
            fresh = frozen(np.array([not missing & bits for bits in self._joint_bits]))
            self._age_ticks = np.where(fresh, 0, self._age_ticks + 1)
            self._age_s = frozen(np.multiply(self._age_ticks, self._period_s, dtype=float))
            if self._start_ticks:
                self._start_ticks -= 1
                self._starting = frozen(self._starting & ~fresh)
            else:
                self._starting = self.none
        else:
            self._age_ticks, self._age_s = self._no_ticks, self._no_age
            self._starting, self._start_ticks = self.none, 0
        return Freshness(fresh if self._prompt else self.none, self._age_s, self._starting)


def frozen(array: NDArray[T]) -> NDArray[T]:
    """The array, read-only from now on."""
    array.setflags(write=False)
    return array
