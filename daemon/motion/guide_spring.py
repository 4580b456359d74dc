# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Spring of a guide: where the guide began, the tool's distance from it, and the velocity back.

It acts only while a hand pushes, and not from further than _SLIP_M: what is further, or held by no
spring, moves the place where the guide began. An obstacle on the way back seems a hand. So the
spring fades as the force against it grows, from _WHOLE_N to _NONE_N: further force is not built up.
Where a force withstands it for _BLOCKED_S, its axis is damped instead of stiff until nothing pushes
the arm, and then begins anew where the tool is: an obstacle, or a clamped hand, is released. If
more than _PRESSES_N remain for as long again, others clamp it, and all stiff axes are damped.

Ordinary Python, which runs as it is; `guide_spring.pxd` names types for the compiler.
"""

from math import sqrt

import numpy as np

from common.arrays import Matrix, Vector

FREE, DAMPED, HELD, STIFF = 0, 1, 2, 3
"""Kinds of an axis: as eq. (15) moves it, more slowly, not at all, and held by a spring."""
ARM_M = 0.3
"""Distance from the axis at which the displacement of a point counts as that of a rotation"""

_SPRING_M_S, _SLIP_M = 0.1, 0.03  # fastest, and longest way
_WHOLE_N, _BLOCKS_N, _NONE_N = 20.0, 22.0, 28.0
_OFF_M, _BLOCKED_S, _PRESSES_N = 2e-4, 1.0, 10.0
_ARM_M, _DAMPED, _STIFF = ARM_M, DAMPED, STIFF  # for the compiler


class GuideSpring:
    """Spring of the six axes of one guide; arrays (6,) are of x, y, z and the rotations about them,
    rotations in m and N at ARM_M."""

    def __init__(self, kinds: Vector, rate: float) -> None:
        """kinds: of each axis; rate: of the spring [1/s]."""
        self._rate = rate
        self._set = np.array(kinds, dtype=np.int64)
        self.kind = self._set.copy()
        """Kind of each axis in this tick"""
        self.off, self.back, self._blocked_s, self._d = np.zeros((4, 6))
        self._x, self._N = np.zeros(3), np.zeros((3, 3))

    def begin(self, x: Vector, M: Matrix) -> None:
        """Begin at the point x (3,) [m] and orientation M (3, 3) along the guide's axes."""
        self._stiffen()
        for a in range(3):
            self._x[a] = x[a]
            for b in range(3):
                self._N[a, b] = M[a, b]

    def measure(self, x: Vector, G: Matrix, M: Matrix, hand: bool) -> None:
        """Distance `off` of x (3,) and M (3, 3) from the guide along its axes, the columns of G,
        and velocity `back` [m/s], 0 without a hand."""
        N, d = self._N, self._d
        if not hand:
            self._stiffen()
        for a in range(6):
            off, b, c = 0.0, (a + 1) % 3, (a + 2) % 3
            for k in range(3):
                if a < 3:
                    off += G[k, a] * (x[k] - self._x[k])
                else:
                    off += 0.5 * _ARM_M * (N[b, k] * M[c, k] - N[c, k] * M[b, k])
            kept = min(max(off, -_SLIP_M), _SLIP_M) if self.kind[a] == _STIFF else 0.0
            self.off[a], d[a] = kept, (off - kept) / (1.0 if a < 3 else _ARM_M)
            kept = self._rate * kept if hand else 0.0
            self.back[a] = min(max(-kept, -_SPRING_M_S), _SPRING_M_S)
        for k in range(3):
            for a in range(3):
                self._x[k] += G[k, a] * d[a]
            n0, n1, n2 = N[0, k], N[1, k], N[2, k]
            N[0, k] += d[4] * n2 - d[5] * n1
            N[1, k] += d[5] * n0 - d[3] * n2
            N[2, k] += d[3] * n1 - d[4] * n0
            one = 1.0 / sqrt(N[0, k] * N[0, k] + N[1, k] * N[1, k] + N[2, k] * N[2, k])
            for a in range(3):
                N[a, k] *= one

    def _stiffen(self) -> None:
        """Every axis is of its own kind again."""
        for a in range(6):
            self.kind[a], self._blocked_s[a] = self._set[a], 0.0

    def withstand(self, a: int, force: float, dt: float) -> None:
        """Fade `back` of axis a by the `force` [N] along it in this tick of dt [s]."""
        against = force if self.off[a] > 0.0 else -force
        self.back[a] *= min(max((_NONE_N - against) / (_NONE_N - _WHOLE_N), 0.0), 1.0)
        gave = self.kind[a] != self._set[a]
        blocked = abs(self.off[a]) > _OFF_M and against > _BLOCKS_N
        blocked = abs(force) > _PRESSES_N if gave else blocked
        self._blocked_s[a] = max(self._blocked_s[a] + (dt if blocked else -dt), 0.0)
        if self._blocked_s[a] > _BLOCKED_S:
            self._blocked_s[a] = 0.0
            for b in range(6):
                if self.kind[b] == _STIFF and (gave or a == b):
                    self.kind[b] = _DAMPED
