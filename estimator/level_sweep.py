"""Level sweep: the contacts that a residual would have caused at each of many levels. Pure
functions.

The highest level that each tick exceeds is known (`alarms.critical_level`); with the debounce, it
is the least of those of the last ticks. So one pass over a recording counts for all levels at once:
a contact begins at each level between that of the previous tick and that of this one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector

FADE_S: Final = 0.3
"""Time after a touch in which a contact is not false [s]: the residual still decays, and the link
swings back through its gap."""
Counts = NDArray[np.int64]


class Debounce:
    """Highest level that each joint has exceeded for `ticks` consecutive ticks, on one side."""

    def __init__(self, n: int, ticks: int) -> None:
        self._ticks = ticks
        self._tail = np.zeros((ticks - 1, n))

    def forget(self) -> None:
        """Restart after an interruption of the ticks."""
        self._tail[:] = 0.0

    def add(self, critical: Matrix, residual: Matrix) -> Matrix:
        """Levels exceeded (ticks, n) [Nm], signed by side, from critical levels and residuals of
        consecutive ticks; 0 where none is."""
        signed = np.vstack([self._tail, np.copysign(critical, residual)])
        windows = np.lib.stride_tricks.sliding_window_view(signed, self._ticks, axis=0)
        low, high = windows.min(axis=-1), windows.max(axis=-1)
        self._tail = signed[len(signed) - self._ticks + 1 :]
        passed: Matrix = np.maximum(low, 0.0) + np.minimum(high, 0.0)
        return passed


@dataclass(frozen=True, slots=True)
class Window:
    """Time window in which a person touched the arm [s]."""

    begin_s: float
    end_s: float


@dataclass(slots=True, eq=False)
class Sweep:
    """Contacts at each of `count` levels, over the ticks added.

    `windows` are the touches to be detected. A contact that begins outside of all `touches` (by
    default the same), and of FADE_S after each, is false.
    """

    count: int
    windows: Sequence[Window] = ()
    touches: Sequence[Window] | None = None
    contacts: Counts = field(init=False)
    """(count,) contacts that began"""
    false: Counts = field(init=False)
    """(count,) those that began outside of every touch"""
    beyond: Counts = field(init=False)
    """(count,) ticks in contact"""
    delays_s: Matrix = field(init=False)
    """(windows, count) from the start of a touch to its first tick in contact; inf if none [s]"""
    _before: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.contacts, self.false, self.beyond = np.zeros((3, self.count), dtype=np.int64)
        self.delays_s = np.full((len(self.windows), self.count), np.inf)

    def forget(self) -> None:
        """Restart after an interruption of the ticks."""
        self._before = 0

    def add(self, time_s: Vector, passed: Counts) -> None:
        """Add consecutive ticks (ticks,); passed: number of levels exceeded, signed by side."""
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
    """Number of the ascending levels below `passed` (ticks,), with its sign."""
    count = np.searchsorted(levels, np.abs(passed), side="left")
    return np.where(passed < 0.0, -count, count)


def _between(low: Counts, high: Counts, count: int) -> Counts:
    """Number of spans low <= k < high that contain each k."""
    edges = np.bincount(low, minlength=count + 1) - np.bincount(high, minlength=count + 1)
    return np.cumsum(edges)[:count]


def _inside(time_s: Vector, windows: Sequence[Window]) -> NDArray[np.bool_]:
    """Ticks within a window, or within FADE_S after one."""
    inside = np.zeros(len(time_s), dtype=np.bool_)
    for window in windows:
        inside |= (time_s >= window.begin_s) & (time_s <= window.end_s + FADE_S)
    return inside
