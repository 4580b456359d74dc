# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Constraint rows of a guide: combinations of joint velocities, each of which has a goal.

Ordinary Python, which runs as it is; `constraint_rows.pxd` names types for the compiler.
"""

from math import sqrt

import numpy as np

from common.arrays import Vector

_RIGID, _TINY = 1e-5, 1e-12  # least compliance, over the mean mobility of rows; and beside it
# Mobility, over that of the fastest gain at 0.3 m, from which on a row is held: below, rounding and
# the last micrometre would choose its direction.
_FLAT, _REACH = 1e-4, 0.09


class ConstraintRows:
    """Up to `most` rows `A` (most, n), each with its compliance `c` over its own mobility, the
    velocity that is its `goal`, the `excess` over it, that of its `spring`, and its `force`."""

    def __init__(self, most: int, n: int) -> None:
        self._n = n
        self.A, self._S = np.zeros((most, n)), np.zeros((most, most))
        self.c, self.goal, self.excess, self.spring, self.force = np.zeros((5, most))

    def factor(self, rows: int, gain: Vector) -> float:
        """S = A K A^T + C as its Cholesky factor; returns the least mobility of a rigid row beside
        those before it, over their mean."""
        A, S, mean, least, flat = self.A, self._S, 0.0, 1.0, _TINY
        for i in range(self._n):
            flat = max(flat, _FLAT * _REACH * gain[i])
        for r in range(rows):
            for s in range(r + 1):
                S[r, s] = 0.0
                for i in range(self._n):
                    S[r, s] += gain[i] * A[r, i] * A[s, i]
            mean += S[r, r] / rows
        for r in range(rows):
            beyond = flat / (S[r, r] + _TINY)
            S[r, r] += self.c[r] * S[r, r] + flat * beyond * beyond + _RIGID * mean + _TINY
            for s in range(r + 1):
                for k in range(s):
                    S[r, s] -= S[r, k] * S[s, k]
                if s < r:
                    S[r, s] /= S[s, s]
            if self.c[r] == 0.0:
                least = min(least, S[r, r] / (mean + _TINY))
            S[r, r] = sqrt(S[r, r])
        return float(least)

    def measure_excess(self, rows: int, v: Vector) -> None:
        """Velocity of each row beyond its goal, as v (n,) has it."""
        for r in range(rows):
            self.excess[r] = -self.goal[r]
            for i in range(self._n):
                self.excess[r] += self.A[r, i] * v[i]

    def correction(self, rows: int, gain: Vector, velocity: Vector, out: Vector) -> None:
        """Velocity K A^T force into out, by which the rows have this `velocity` (rows,), and the
        force S^-1 velocity of each."""
        S, y = self._S, self.force
        for r in range(rows):
            y[r] = velocity[r]
            for s in range(r):
                y[r] -= S[r, s] * y[s]
            y[r] /= S[r, r]
        for r in range(rows - 1, -1, -1):
            for s in range(r + 1, rows):
                y[r] -= S[s, r] * y[s]
            y[r] /= S[r, r]
        for i in range(self._n):
            out[i] = 0.0
            for r in range(rows):
                out[i] += gain[i] * self.A[r, i] * y[r]
