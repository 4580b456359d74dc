# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Walls: the bound on setpoints that keeps links apart from each other and from their surroundings.

A link that approaches must still be able to stop within the remaining gap d. In the given mixture
of joint velocities the gap closes at s = sum |g_i v_i| over the joints that close it, g = d d / d
q, and their accelerations a_i slow it down by

    A = s^2 / sum |g_i| v_i^2 / a_i,       s <= `Limits.funnel` of d and A,    s' = -g . v.

Only the joints that close a gap are slowed, in proportion to g_i, and none beyond 0: the others
continue, so the arm slides along, and no joint moves that was not to move. Standing still always
satisfies the bound. A joint that opens a gap counts only as far as it is measured to move: one that
is held makes no room for the others. Drives lag, so that sliding along a curved shape sinks into
the kept margin: at -d the gap must open at d / (4 tau), as far as slowing its closing joints
allows.

Shapes may overlap at the start: a file is wrong, or a keep-out zone contains the arm. For such a
pair d counts from a floor, `SINKS_M` below the deepest point, which rises with that: a link that
turns out of an overlap lowers a corner, and with it the deepest point, by some millimetres.
"""

from math import sqrt

import numpy as np

from common.arrays import Matrix, Vector
from estimator.clearance import Clearance

_SWEEPS = 20
_SLOWS = 1e-3  # [rad/s]
_UNKNOWN = -1e300
SINKS_M = 0.003
"""Depth by which an existing overlap may deepen [m]."""
_TINY = 1e-12


class Walls:
    """Velocity bound from the gaps of `clearance`, of which a `margin` [m] is kept; acceleration
    (n,) [rad/s2] and reaction_s as in `Limits`.

    `bound` sets `nearest`, the row with the smallest gap, its `distance` [m] before margin and
    play, and `slows`, whether a wall slows a joint.
    """

    def __init__(
        self, clearance: Clearance, acceleration: Vector, reaction_s: float, margin: float
    ) -> None:
        rows = len(clearance.gap)
        self.clearance = clearance
        self._acceleration, self._reaction_s = acceleration.copy(), reaction_s
        self._margin = margin
        self._active = np.zeros(rows, dtype=np.int64)
        self._most, self._moved = np.zeros(rows), np.zeros(clearance.n)
        self._room, self._deepest = np.zeros((2, rows))
        self._floor, self._anew = np.full(len(clearance.pairs), _UNKNOWN), False
        self.nearest, self.distance, self.slows = -1, 1e300, False

    def bound(self, q: Vector, moved: Vector, wanted: Vector, play: Matrix, out: Vector) -> None:
        """Write the bounded velocity (n,) [rad/s] to out, at q (n,) [rad] and measured velocities
        `moved` (n,), where NaN counts as 0, for links that may fall by `play` (2, n) [rad] in their
        gaps, as in `Limits.bound_velocity`. 0 if a position is not a number; unchanged if a
        velocity wanted is not, as the drives are then commanded to stop."""
        c, known, moves = self.clearance, 0.0, 0.0
        for i in range(c.n):
            out[i] = wanted[i]
            self._moved[i] = moved[i] if moved[i] - moved[i] == 0.0 else 0.0
            known += q[i]
            moves += wanted[i]
        self.slows, self.nearest, self.distance = False, -1, 1e300
        if moves - moves != 0.0:
            return
        if known - known != 0.0:
            for i in range(c.n):
                out[i] = 0.0
            return
        c.at(q)
        active = self._too_fast(play, out)
        for _ in range(_SWEEPS):
            over = False
            for k in range(active):
                over = self._slow(self._active[k], self._most[k], out) or over
            if not over:
                break
        self._fulfil(active, out)
        for i in range(c.n):
            self.slows = self.slows or abs(out[i] - wanted[i]) > _SLOWS

    def forget(self) -> None:
        """At the next bound accept overlaps that are deeper by more than drives may sink: the arm
        may be moved by hand meanwhile."""
        self._anew = True

    def touch(self, q: Vector) -> bool:
        """True if shapes overlap at q (n,) [rad]; `clearance` then holds the gaps there."""
        self.clearance.at(q)
        return bool(np.min(self.clearance.gap, initial=1.0) < 0.0)

    def _too_fast(self, play: Matrix, out: Vector) -> int:
        """Find the rows that may close too fast, however the joints that open them are slowed, and
        the limit of each [m/s]; returns their number."""
        c, active = self.clearance, 0
        self._measure(play)
        for row in range(c.gap.shape[0]):
            closing = used = 0.0
            gap = self._room[row] - self._floor[c.whole[row]]
            for i in range(c.n):
                g = c.gradient[row, i]
                if g * out[i] < 0.0:
                    closing -= g * out[i]
                    used += abs(g) * out[i] * out[i] / self._acceleration[i]
            if closing > _TINY:
                most = self._funnel(gap, closing * closing / used)
                if closing > most:
                    self._active[active], self._most[active] = row, most
                    active += 1
        return active

    def _measure(self, play: Matrix) -> None:
        """Compute the gap of each row less margin and play [m], and the floor of each pair."""
        c, sinks = self.clearance, SINKS_M
        for row in range(c.gap.shape[0]):
            self._deepest[row] = 1e300
        for row in range(c.gap.shape[0]):
            if c.gap[row] < self.distance:
                self.nearest, self.distance = row, c.gap[row]
            self._room[row] = c.gap[row] - self._margin
            for i in range(c.n):
                g = c.gradient[row, i]
                self._room[row] -= g * play[0, i] if g > 0.0 else -g * play[1, i]
            pair = c.whole[row]
            self._deepest[pair] = min(self._deepest[pair], self._room[row])
        for k in range(self._floor.shape[0]):
            if self._anew and self._deepest[k] < self._floor[k] - sinks:
                self._floor[k] = _UNKNOWN
            if self._floor[k] == _UNKNOWN and c.least[k] >= 0.0:
                self._floor[k] = 0.0
            elif self._floor[k] < 0.0:
                now = self._deepest[k] - sinks
                if c.least[k] >= 0.0:  # no overlap now; the margin is restored as the gap grows
                    now = max(now, -self._margin)
                self._floor[k] = min(max(self._floor[k], now), 0.0)
        self._anew = False

    def _funnel(self, gap: float, A: float) -> float:
        """`Limits.funnel` of a gap [m] at a deceleration A [m/s2], continued linearly below 0."""
        if gap < 0.0:
            return gap / (4.0 * self._reaction_s)
        slack = 4.0 * self._reaction_s * A
        return float(sqrt(slack * slack + 2.0 * A * gap) - slack)

    def _slow(self, row: int, most: float, out: Vector) -> bool:
        """Slow the joints that close the gap of a row, until it closes at `most` [m/s]: the nearest
        such velocity, without a change of sign. True if it closed faster."""
        c, slowed = self.clearance, False
        for _ in range(c.n):
            over, square = self._closing(row, out) - most, 0.0
            for i in range(c.n):
                g = c.gradient[row, i]
                square += g * g if g * out[i] < 0.0 else 0.0
            if over <= _TINY or square == 0.0:
                break
            slowed = True
            for i in range(c.n):
                g = c.gradient[row, i]
                if g * out[i] < 0.0:
                    v = out[i] + over / square * g
                    out[i] = v if v * out[i] > 0.0 else 0.0
        return slowed

    def _closing(self, row: int, out: Vector) -> float:
        """Speed at which the gap of a row closes [m/s]."""
        closing = 0.0
        for i in range(self.clearance.n):
            g, v = self.clearance.gradient[row, i], out[i]
            if g * v > 0.0:
                v = (
                    min(max(self._moved[i], 0.0), v)
                    if v > 0.0
                    else max(min(self._moved[i], 0.0), v)
                )
            closing -= g * v
        return closing

    def _fulfil(self, active: int, out: Vector) -> None:
        """Scale down all joints if the sweeps did not converge."""
        share = 1.0
        for k in range(active):
            closing, most = self._closing(self._active[k], out), max(self._most[k], 0.0)
            if closing * share > most + 1e-9:
                share = most / closing
        for i in range(self.clearance.n):
            out[i] *= share
