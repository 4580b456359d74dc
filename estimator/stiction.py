# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Stiction: friction near rest, which the velocity does not determine.

Smooth friction vanishes with the velocity. Stiction keeps what the last motion left, and changes
only as the joint is displaced by some thousandths of a radian: its pre-sliding. Real friction lies
between both, and so does what is believed here:

    z += displacement / presliding, held within -1 ... 1                    (the stop operator)
    tau = stiction * K_theta_s * (z - s(theta_dot)), beside K_theta_s s(theta_dot) of (6)

In motion z = s(theta_dot) = +-1, and tau vanishes. What z was in the beginning is unknown: it is
followed from both ends, which meet once the joint was displaced far enough.

Ordinary Python, which runs as it is; `stiction.pxd` names the types for the compiler.
"""

import numpy as np

from estimator.transmission import CREEP, LINK_REST


def displacement(theta_dot: float, q_dot: float, moved: float, has_gap: bool, dt: float) -> float:
    """Displacement [rad] over dt [s] of a rotor whose position is not measured; `moved` is that of
    its link. Where both creep, rotor and link are taken for one, as they are where there is no gap:
    a link's encoder does not drift."""
    alone = abs(theta_dot) > CREEP or abs(q_dot) > LINK_REST
    return theta_dot * dt if alone and has_gap else moved


class Stiction:
    """z of each joint as an interval, `ends` (2, n); from -1 ... 1 on, where nothing is known.

    presliding [rad], > 0: from no friction to all of it.
    """

    def __init__(self, n: int, presliding: float) -> None:
        self._per_presliding = 1.0 / presliding
        self.ends = np.repeat([[-1.0], [1.0]], n, axis=1)

    def restart(self, i: int) -> None:
        """Forget what the last motion of joint i left."""
        self.ends[0, i], self.ends[1, i] = -1.0, 1.0

    def step(self, i: int, displacement: float) -> None:
        """Move on by the displacement of rotor i [rad]."""
        for end in range(2):
            z = self.ends[end, i] + displacement * self._per_presliding
            self.ends[end, i] = min(max(z, -1.0), 1.0)

    def z(self, i: int) -> float:
        """Share of the Coulomb friction that is held, signed as the motion that built it up."""
        return float(0.5 * (self.ends[0, i] + self.ends[1, i]))

    def unknown(self, i: int) -> float:
        """Largest error of z: 1 where nothing is known, 0 after a motion."""
        return float(0.5 * (self.ends[1, i] - self.ends[0, i]))
