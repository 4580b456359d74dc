# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Frame at a point of the arm: its Jacobian and its pose, from a pose that `Dynamics` has computed,
in one walk from its body to the root."""

import numpy as np

from estimator.dynamics import Dynamics, Place


class Frame:
    """Jacobian and pose of a frame: `J` (6, n), its linear and angular velocity along its own axes
    per joint velocity; `x` (3,) [m] and `R` (3, 3), origin and axes (columns) in the root frame."""

    def __init__(self, dynamics: Dynamics, place: Place) -> None:
        self._dynamics, self._body = dynamics, place.body
        self._place, self._axes = place.point.copy(), place.axes.copy()
        self.J = np.zeros((6, dynamics.n))
        self.x, self._swap = np.zeros((2, 3))
        self.R, self._swaps = np.zeros((2, 3, 3))

    def at(self) -> None:
        """Compute `J`, `x` and `R` at the pose of the last `Dynamics.at`."""
        d, i, x, R, J = self._dynamics, self._body, self.x, self.R, self.J
        for a in range(3):
            x[a] = self._place[a]
            for b in range(3):
                R[a, b] = self._axes[a, b]
        while i >= 0:
            row = d._row[i]
            T0, T1, T2 = d._turning[i, 0], d._turning[i, 1], d._turning[i, 2]
            v0 = T1 * x[2] - T2 * x[1] + d._sliding[i, 0]
            v1 = T2 * x[0] - T0 * x[2] + d._sliding[i, 1]
            v2 = T0 * x[1] - T1 * x[0] + d._sliding[i, 2]
            for k in range(3):
                J[k, row] = R[0, k] * v0 + R[1, k] * v1 + R[2, k] * v2
                J[3 + k, row] = R[0, k] * T0 + R[1, k] * T1 + R[2, k] * T2
            for a in range(3):
                R0, R1, R2 = d._R[i, a, 0], d._R[i, a, 1], d._R[i, a, 2]
                self._swap[a] = R0 * x[0] + R1 * x[1] + R2 * x[2] + d._t[i, a]
                for k in range(3):
                    self._swaps[a, k] = R0 * R[0, k] + R1 * R[1, k] + R2 * R[2, k]
            for a in range(3):
                x[a] = self._swap[a]
                for k in range(3):
                    R[a, k] = self._swaps[a, k]
            i = d._parent[i]
