"""Computation of day records from the rows that the daemon sends, one per tick.

Rows are processed in stretches without missing ticks. Pure: no I/O, no clock.
"""

import warnings
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from daemon.protocol.trend_row import (
    DOUBT,
    FRICTION,
    HEAD,
    PER_JOINT,
    QUIET,
    RESIDUAL,
    THETA,
    THETA_DOT,
    TICK,
    WALL,
    Q,
)
from identification.gap_in_motion import from_motion
from programs.trends.day import Day, JointDay

#: Length of an interval in which gap and skew are evaluated [s], and crossings that it needs.
LOOK_S: Final = 120.0
CROSSINGS: Final = 4
_SHORTEST_S: Final = 40.0  # least length of such an interval
_MOVES: Final = 0.05  # least speed that counts as motion [rad/s]
# Learned friction is used if less than this share of its initial standard deviation is left.
_KNOWN: Final = 0.35
# Bounds of learned friction, over the identified one (estimator/learning.py)...
FRICTION_RANGE: Final = (0.3, 2.2)
# ...and the distance from them within which it counts as at the bound.
_AT_BOUND: Final = 0.0035


class Gatherer:
    """Accumulator of one arm's day records."""

    def __init__(
        self, arm: str, joints: Sequence[str], period_s: float, identified: dict[str, str]
    ) -> None:
        self._arm, self._joints, self._period_s = arm, tuple(joints), period_s
        self._identified = identified
        self._stretch: list[Matrix] = []
        self._rows = 0

    def take(self, rows: Matrix, days: dict[str, Day]) -> None:
        """Add rows (ticks, row_length) in order to the records in `days`."""
        if not len(rows):
            return
        breaks = np.flatnonzero(np.diff(rows[:, TICK]) != 1.0) + 1
        for part in np.split(rows, breaks):
            if self._rows and part[0, TICK] != self._stretch[-1][-1, TICK] + 1.0:
                self._look(days)
            self._stretch.append(part)
            self._rows += len(part)
            self._learned(part, self._day(part, days))
            if self._rows * self._period_s >= LOOK_S:
                self._look(days)

    def end(self, days: dict[str, Day]) -> None:
        """Evaluate the last interval."""
        self._look(days)

    def _day(self, rows: Matrix, days: dict[str, Day]) -> Day:
        date = datetime.fromtimestamp(rows[-1, WALL], UTC).date().isoformat()
        if date not in days:
            days[date] = Day(arm=self._arm, date=date, identified=self._identified)
        day = days[date]
        for name in self._joints:
            day.joints.setdefault(name, JointDay())
        return day

    def _column(self, rows: Matrix, joint: int, what: int) -> Vector:
        column: Vector = rows[:, HEAD + PER_JOINT * joint + what]
        return column

    def _learned(self, rows: Matrix, day: Day) -> None:
        """Add friction and residual of each joint, in motion without contact, and times."""
        quiet = rows[:, QUIET] > 0.0
        for i, name in enumerate(self._joints):
            into = day.joints[name]
            speed, residual = self._column(rows, i, THETA_DOT), self._column(rows, i, RESIDUAL)
            moves = np.abs(speed) > _MOVES
            into.moved_s += self._period_s * int(np.count_nonzero(moves))
            friction = self._column(rows, i, FRICTION)
            known = moves & quiet & (self._column(rows, i, DOUBT) < _KNOWN)
            if known.any():
                seconds = self._period_s * int(np.count_nonzero(known))
                into.friction.put(float(friction[known].mean()), seconds)
            for sums, direction in (
                (into.forth, moves & (speed > 0.0)),
                (into.back, moves & (speed < 0)),
            ):
                used = direction & quiet
                if used.any():
                    seconds = self._period_s * int(np.count_nonzero(used))
                    sums.put(float(residual[used].mean()), seconds)
            least, most = FRICTION_RANGE
            at = (friction < least + _AT_BOUND) | (friction > most - _AT_BOUND)
            into.bound_s += self._period_s * int(np.count_nonzero(moves & at))

    def _look(self, days: dict[str, Day]) -> None:
        """Evaluate gap and skew of each joint in the present interval, and start another."""
        stretch, self._stretch, self._rows = self._stretch, [], 0
        rows = np.concatenate(stretch) if stretch else np.empty((0, 0))
        if len(rows) * self._period_s < _SHORTEST_S:
            return
        day = self._day(rows, days)
        time_s: Vector = self._period_s * np.arange(len(rows), dtype=np.float64)
        for i, name in enumerate(self._joints):
            speed = self._column(rows, i, THETA_DOT)
            if np.count_nonzero(np.abs(speed) > _MOVES) * self._period_s < 0.1 * _SHORTEST_S:
                continue
            theta = self._column(rows, i, THETA)
            measured = bool(np.isfinite(theta).all())
            if not measured:
                theta = np.asarray(self._period_s * np.cumsum(speed), dtype=np.float64)
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                found = from_motion(
                    name, time_s, self._column(rows, i, Q), theta, speed, enough=CROSSINGS
                )
            day.joints[name].half_gap.put(found.half_gap)
            if measured:
                day.joints[name].skew_ms.put(1000.0 * found.skew_s)
