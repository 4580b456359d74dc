"""Gathering of a day's record from the rows that the daemon sends, one for each tick.

Rows are taken in stretches without a gap. Pure: no I/O, no clock.
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

#: A look at gap and skew takes so much of a stretch [s], and needs so many crossings.
LOOK_S: Final = 120.0
CROSSINGS: Final = 4
_SHORTEST_S: Final = 40.0
_MOVES: Final = 0.05  # [rad/s]
# Friction is known where less than this is left of its deviation.
_KNOWN: Final = 0.35
# Least and most that is learned of friction, over what was identified (estimator/learning.py)...
FRICTION_RANGE: Final = (0.3, 2.2)
# ...and how near to them it is there.
_AT_BOUND: Final = 0.0035


class Gatherer:
    """Days of one arm that are being gathered, by date."""

    def __init__(
        self, arm: str, joints: Sequence[str], period_s: float, identified: dict[str, str]
    ) -> None:
        self._arm, self._joints, self._period_s = arm, tuple(joints), period_s
        self._identified = identified
        self._stretch: list[Matrix] = []
        self._rows = 0

    def take(self, rows: Matrix, days: dict[str, Day]) -> None:
        """Take rows (ticks, row_length) in order, and add to `days` what they show."""
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
        """Take what is left."""
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
        """Add friction and remainder of each joint, in motion without contact."""
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
            for sums, way in (
                (into.forth, moves & (speed > 0.0)),
                (into.back, moves & (speed < 0)),
            ):
                there = way & quiet
                if there.any():
                    seconds = self._period_s * int(np.count_nonzero(there))
                    sums.put(float(residual[there].mean()), seconds)
            least, most = FRICTION_RANGE
            at = (friction < least + _AT_BOUND) | (friction > most - _AT_BOUND)
            into.bound_s += self._period_s * int(np.count_nonzero(moves & at))

    def _look(self, days: dict[str, Day]) -> None:
        """Look at gap and skew of each joint in the stretch so far, and begin another."""
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
