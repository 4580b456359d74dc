"""Signals of a recording for a plot: one row per tick, or the least and largest of several.

An hour has 360000 ticks, more than a plot can show. Ticks are therefore gathered into buckets, of
which the least and largest value are kept, so that no peak is lost. Buckets hold one tick at first;
whenever there are too many, pairs of them are merged, so that memory does not grow with the
recording. Pure.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.protocol.state import State

#: Fields of a State that are drawn, one value per joint.
DRAWN: Final = (
    "residual",
    "threshold",
    "link_velocity",
    "motor_velocity",
    "current",
    "phi",
    "phi_sigma",
)


Rows = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ModeSpan:
    """Time span spent in one mode [s]."""

    begin_s: float
    end_s: float
    mode: str


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Arrays of the points to plot; NaN where States are missing."""

    time_s: Vector
    """Times (points,) from the first State of the recording."""
    values: dict[str, Rows]
    """Values (points, n) by field name; two points per bucket, the least and the largest."""
    ticks_per_bucket: int
    modes: tuple[ModeSpan, ...]


@dataclass(slots=True, eq=False)
class SignalGatherer:
    """Gatherer of the States between two times into `most` to 2 * `most` buckets, or fewer with one
    tick each; most >= 2, `n` joints."""

    n: int
    most: int
    from_s: float = -math.inf
    until_s: float = math.inf
    _width: int = 1  # ticks in a bucket
    _count: int = 0  # complete buckets
    _begun_s: float | None = None
    _tick: int | None = None
    _modes: list[ModeSpan] = field(default_factory=list)
    _low: Rows = field(init=False)
    _high: Rows = field(init=False)
    _time_s: Vector = field(init=False)
    _rest: Rows = field(init=False)  # rows that do not fill a bucket yet
    _rest_s: Vector = field(init=False)

    def __post_init__(self) -> None:
        columns = len(DRAWN) * self.n
        self._low, self._high = np.full((2, 2 * self.most, columns), np.nan, dtype=np.float32)
        self._time_s = np.zeros(2 * self.most)
        self._rest, self._rest_s = np.zeros((0, columns), dtype=np.float32), np.zeros(0)

    def add(self, states: Sequence[State]) -> None:
        """Add States in their order; those outside the time span are left out."""
        if self._begun_s is None:
            self._begun_s = states[0].time_s
        begun = self._begun_s
        chosen = [s for s in states if self.from_s <= s.time_s - begun <= self.until_s]
        part: list[State] = []
        for state in chosen:
            if self._tick is not None and state.tick != self._tick + 1:
                self._take(part)
                self._break(state.time_s - begun, str(state.mode))
                part = []
            self._tick = state.tick
            self._in_mode(state.time_s - begun, str(state.mode))
            part.append(state)
        self._take(part)

    def signals(self) -> Signals:
        """Signals of all States added so far."""
        time_s, low, high = self._all()
        if self._width == 1:
            flat, times = low, time_s
        else:
            flat = np.stack([low, high], axis=1).reshape(-1, low.shape[1])
            half = 0.5 * np.diff(time_s, append=time_s[-1:])
            times = np.stack([time_s, time_s + half], axis=1).ravel()
        n = self.n
        values = {name: flat[:, k * n : (k + 1) * n] for k, name in enumerate(DRAWN)}
        return Signals(times, values, self._width, tuple(self._modes))

    def _all(self) -> tuple[Vector, Rows, Rows]:
        """Times, least and largest values of all buckets, including an incomplete last one."""
        k = self._count
        time_s, low, high = self._time_s[:k], self._low[:k], self._high[:k]
        if not len(self._rest):
            return time_s, low, high
        return (
            np.append(time_s, self._rest_s[0]),
            np.vstack([low, np.fmin.reduce(self._rest)]),
            np.vstack([high, np.fmax.reduce(self._rest)]),
        )

    def _in_mode(self, time_s: float, mode: str) -> None:
        last = self._modes[-1] if self._modes else None
        if last is not None and last.mode == mode:
            self._modes[-1] = ModeSpan(last.begin_s, time_s, mode)
            return
        if last is not None:
            self._modes[-1] = ModeSpan(last.begin_s, time_s, last.mode)
        self._modes.append(ModeSpan(time_s, time_s, mode))

    def _take(self, states: Sequence[State]) -> None:
        if not states:
            return
        columns = [_rows(states, name, self.n) for name in DRAWN]
        assert self._begun_s is not None
        times = np.array([state.time_s for state in states]) - self._begun_s
        self._add_rows(times, np.hstack(columns))

    def _break(self, time_s: float, mode: str) -> None:
        """Add a row of NaN and start a new span, so that no line is drawn across missing ticks."""
        self._modes.append(ModeSpan(time_s, time_s, mode))
        row = np.full((1, len(DRAWN) * self.n), np.nan, dtype=np.float32)
        self._add_rows(np.array([time_s]), row)

    def _add_rows(self, times: Vector, rows: Rows) -> None:
        self._rest = np.vstack([self._rest, rows])
        self._rest_s = np.append(self._rest_s, times)
        while (count := len(self._rest) // self._width) > 0:
            count = min(count, 2 * self.most - self._count)
            whole = count * self._width
            shape = (count, self._width, -1)
            part = slice(self._count, self._count + count)
            self._low[part] = np.fmin.reduce(self._rest[:whole].reshape(shape), axis=1)
            self._high[part] = np.fmax.reduce(self._rest[:whole].reshape(shape), axis=1)
            self._time_s[part] = self._rest_s[:whole].reshape(count, -1)[:, 0]
            self._rest, self._rest_s = self._rest[whole:], self._rest_s[whole:]
            self._count += count
            if self._count == 2 * self.most:
                self._merge()

    def _merge(self) -> None:
        """Merge pairs of buckets."""
        half = self._count // 2
        self._low[:half] = np.fmin(self._low[0::2], self._low[1::2])
        self._high[:half] = np.fmax(self._high[0::2], self._high[1::2])
        self._time_s[:half] = self._time_s[0::2]
        self._count, self._width = half, 2 * self._width


def _rows(states: Sequence[State], name: str, n: int) -> Rows:
    """Values (ticks, n) of one field of the States."""
    with np.errstate(over="ignore"):  # implausible values overflow to infinity, and are not drawn
        return _array(states, name, n)


def _array(states: Sequence[State], name: str, n: int) -> Rows:
    flat = chain.from_iterable(getattr(state, name) for state in states)
    return np.fromiter(flat, np.float32, n * len(states)).reshape(len(states), n)
