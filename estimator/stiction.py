# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Stiction: friction near rest, which the velocity does not determine.

A smooth friction law vanishes with the velocity. Stiction keeps what the last motion left, and
changes only as the joint is displaced by some thousandths of a radian, its pre-sliding distance.
Real friction lies between both, and so does the model:

    z += displacement / presliding, held within -1 ... 1                    (the stop operator)
    tau = stiction * K_theta_s * (z - s(theta_dot)), beside K_theta_s s(theta_dot) of (6)

In motion z = s(theta_dot) = +-1, and tau vanishes. The initial z is unknown: it is tracked from
both extremes, which meet once the joint was displaced far enough. As pre-sliding, or how much is
held, may be unknown, too, several hypotheses are tracked: the truth lies between the lowest and the
highest, or, as it is none of them, not far beyond (after reversals within some milliradians up to
0.36 of the friction, mostly below 0.12: `stiction_share` covers that). The middle is used, with
half the range as its uncertainty.
"""

import numpy as np

from common.arrays import Vector
from estimator.transmission import CREEP, LINK_REST

_BELIEFS = 5  # number of pre-sliding distances that are tracked


def displacement(theta_dot: float, q_dot: float, moved: float, has_gap: bool, dt: float) -> float:
    """Displacement [rad] over dt [s] of a rotor whose position is not measured; `moved` is that of
    its link. Where both creep, rotor and link count as one, as they do without a gap: a link
    encoder does not drift."""
    alone = abs(theta_dot) > CREEP or abs(q_dot) > LINK_REST
    return theta_dot * dt if alone and has_gap else moved


class Stiction:
    """Friction that joints hold near rest beyond that of their velocity, as shares of Coulomb
    friction: `held` (n,), and its uncertainty `unknown` (n,).

    presliding [rad], > 0: shortest and longest distance over which friction builds up.
    """

    def __init__(
        self, n: int, presliding: tuple[float, float], least: Vector, most: Vector
    ) -> None:
        """least, most (n,): bounds of the stiction, 0 ... 1."""
        self._per_presliding = 1.0 / np.geomspace(*presliding, _BELIEFS)
        self._least, self._most = least.copy(), most.copy()
        self.ends = np.empty((2, _BELIEFS, n))
        self.held, self.unknown = np.zeros((2, n))
        for i in range(n):
            self.restart(i)

    def restart(self, i: int) -> None:
        """Forget what the last motion of joint i left."""
        for k in range(_BELIEFS):
            self.ends[0, k, i], self.ends[1, k, i] = -1.0, 1.0
        self.held[i], self.unknown[i] = 0.0, self._most[i]

    def unknown_at_rest(self, i: int) -> float:
        """Uncertainty of the stiction of joint i at rest, now or later: share of Coulomb
        friction."""
        return float(max(self.unknown[i], 0.5 * (self._most[i] - self._least[i])))

    def step(self, i: int, displacement: float, sign: float) -> None:
        """Advance by the displacement of rotor i [rad]; sign: s(theta_dot)."""
        lowest, highest = 1.0, -1.0
        for k in range(_BELIEFS):
            way = displacement * self._per_presliding[k]
            low = min(max(self.ends[0, k, i] + way, -1.0), 1.0)
            high = min(max(self.ends[1, k, i] + way, -1.0), 1.0)
            self.ends[0, k, i], self.ends[1, k, i] = low, high
            lowest, highest = min(lowest, low), max(highest, high)
        low, high = lowest - sign, highest - sign
        least, most = self._least[i], self._most[i]
        low, high = min(least * low, most * low), max(least * high, most * high)
        self.held[i], self.unknown[i] = 0.5 * (low + high), 0.5 * (high - low)
