"""Fixed-rate loop: one tick per absolute deadline, then `doors` (clients and the log), then sleep.

All deadlines lie on one grid, so that lateness does not accumulate. After a late wake-up every
deadline that the drives' answers would overlap is counted and skipped, never caught up: to the
drives, two ticks in a burst would make time appear to run twice as fast.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from daemon.tick.telemetry import Wakeup
from daemon.tick.tick import Tick

# Share of the period in which the drives must have answered SYNC; no tick follows sooner.
ANSWER_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class Clock:
    """Time source of the loop, and its sleep function."""

    now: Callable[[], float]  # monotonic [s]
    sleep_until: Callable[[float], None]
    wall: Callable[[], float]  # Unix time [s]; for display and recordings only


def skipped_deadlines(lateness: float) -> int:
    """Deadlines to skip after a wake-up that is this many periods late: the next one of the grid
    must leave the current tick time for the drives' answers."""
    return max(math.ceil(lateness + ANSWER_SHARE) - 1, 0)


class Loop:
    """Loop that runs `tick` every `period_s`."""

    def __init__(self, tick: Tick, clock: Clock, period_s: float) -> None:
        self.tick = tick
        self.missed = 0
        self.lateness_max_s = 0.0
        self.work_max_s = 0.0
        self._clock, self._period_s = clock, period_s
        self._start_s = clock.now()
        self._deadline_s = self._start_s + period_s  # of the next tick
        self.work_s = 0.0  # of the last tick, from its wake-up
        self._doors_s = 0.0

    @property
    def now_s(self) -> float:
        """Time of the clock [s]."""
        return self._clock.now()

    @property
    def time_s(self) -> float:
        """Time since the loop was created [s]."""
        return self.now_s - self._start_s

    def run(self, doors: Callable[[], None], running: Callable[[], bool]) -> None:
        """Tick until `running()` is false; `doors()` runs after each tick, in its slack."""
        while running():
            self.step()
            began = self._clock.now()
            doors()
            self._doors_s = self._clock.now() - began

    def resume(self) -> None:
        """Begin a new grid after an intended pause, in which no deadline counts as missed."""
        self._deadline_s = self._clock.now() + self._period_s

    def step(self) -> None:
        """Wait for the next deadline and do one tick."""
        clock, period = self._clock, self._period_s
        deadline = self._deadline_s
        clock.sleep_until(deadline)
        woken = clock.now()
        lateness = woken - deadline
        left_out = skipped_deadlines(lateness / period)
        self.missed += left_out
        self._deadline_s = deadline + (1 + left_out) * period
        wakeup = Wakeup(
            monotonic_s=woken,
            lateness_s=lateness,
            work_s=self.work_s,
            missed=self.missed,
            left_out=left_out,
            doors_s=self._doors_s,
            wall_s=clock.wall(),
        )
        self.tick.begin(woken - self._start_s)
        self.tick.finish(woken + ANSWER_SHARE * period, wakeup)
        self.work_s = clock.now() - woken
        self.lateness_max_s = max(self.lateness_max_s, lateness)
        self.work_max_s = max(self.work_max_s, self.work_s)
