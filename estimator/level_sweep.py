"""Sweep over levels: the contacts that a residual would have made at each of many levels. Pure.

Of every tick the highest level it passes is known (`alarms.critical_level`); with the debounce, the
least of these over the last ticks. So one pass over a recording counts for all levels at once: a
contact begins at each level between that of this tick and that of the one before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector

FADE_S: Final = 0.3
"""After a touch the residual still fades, and the link swings back through its gap: a contact that
begins so soon after is no false one."""
Counts = NDArray[np.int64]


class Debounce:
    """Highest level that each joint has passed for `ticks` ticks in a row, on one side."""

    def __init__(self, n: int, ticks: int) -> None:
        self._ticks = ticks
        self._tail = np.zeros((ticks - 1, n))

    def forget(self) -> None:
        """Begin anew, after a gap."""
        self._tail[:] = 0.0

    def add(self, critical: Matrix, residual: Matrix) -> Matrix:
        """Levels (ticks, n) [Nm] with the sign of the side, of critical levels and residuals of
        consecutive ticks; 0 where none is passed."""
        signed = np.vstack([self._tail, np.copysign(critical, residual)])
        windows = np.lib.stride_tricks.sliding_window_view(signed, self._ticks, axis=0)
        low, high = windows.min(axis=-1), windows.max(axis=-1)
        self._tail = signed[len(signed) - self._ticks + 1 :]
        passed: Matrix = np.maximum(low, 0.0) + np.minimum(high, 0.0)
        return passed


@dataclass(frozen=True, slots=True)
class Window:
    """Time in which a person touched the arm [s]."""

    begin_s: float
    end_s: float


@dataclass(slots=True, eq=False)
class Sweep:
    """Contacts at each of `count` levels, over the ticks added.

    `windows` are the touches that were to be found; what begins in none of `touches` (by default
    these), or within FADE_S after, is false.
    """

    count: int
    windows: Sequence[Window] = ()
    touches: Sequence[Window] | None = None
    contacts: Counts = field(init=False)
    """(count,) all that began"""
    false: Counts = field(init=False)
    """(count,) those that began outside of every touch"""
    beyond: Counts = field(init=False)
    """(count,) ticks in which a contact lasted"""
    delays_s: Matrix = field(init=False)
    """(windows, count) from a touch's begin to the first tick of a contact in it; inf: none"""
    _before: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.contacts, self.false, self.beyond = np.zeros((3, self.count), dtype=np.int64)
        self.delays_s = np.full((len(self.windows), self.count), np.inf)

    def forget(self) -> None:
        """Begin anew, after a gap."""
        self._before = 0

    def add(self, time_s: Vector, passed: Counts) -> None:
        """Take consecutive ticks (ticks,): how many of the levels, from the lowest, are passed; the
        sign is that of the side."""
        signed = np.concatenate([[self._before], passed])
        self._before = int(passed[-1])
        now, before = np.abs(passed), np.abs(signed[:-1])
        before[signed[:-1] * passed < 0] = 0
        began = now > before
        outside = began & ~_inside(time_s, self.windows if self.touches is None else self.touches)
        self.contacts += _between(before[began], now[began], self.count)
        self.false += _between(before[outside], now[outside], self.count)
        self.beyond += np.cumsum(np.bincount(now, minlength=self.count + 1)[::-1])[::-1][1:]
        for k, window in enumerate(self.windows):
            first, end = np.searchsorted(time_s, [window.begin_s, window.end_s])
            if first < end:
                self._find(k, time_s[first:end] - window.begin_s, now[first:end])

    def _find(self, k: int, delay_s: Vector, passed: Counts) -> None:
        highest = np.maximum.accumulate(passed)
        first = np.searchsorted(highest, np.arange(self.count), side="right")
        found = first < len(delay_s)
        self.delays_s[k, found] = np.minimum(self.delays_s[k, found], delay_s[first[found]])


def levels_passed(passed: Matrix, levels: Vector) -> Counts:
    """Number of the levels, which ascend, below `passed` (ticks,), with its sign."""
    count = np.searchsorted(levels, np.abs(passed), side="left")
    return np.where(passed < 0.0, -count, count)


def _between(low: Counts, high: Counts, count: int) -> Counts:
    """Number of the spans low <= k < high that hold each k."""
    edges = np.bincount(low, minlength=count + 1) - np.bincount(high, minlength=count + 1)
    return np.cumsum(edges)[:count]


def _inside(time_s: Vector, windows: Sequence[Window]) -> NDArray[np.bool_]:
    """Ticks that lie in a window, or within FADE_S after it."""
    inside = np.zeros(len(time_s), dtype=np.bool_)
    for window in windows:
        inside |= (time_s >= window.begin_s) & (time_s <= window.end_s + FADE_S)
    return inside
