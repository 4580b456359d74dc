"""Stiction: friction near rest, which the velocity does not determine.

Smooth friction vanishes with the velocity. Stiction keeps what the last motion left, and changes
only as the joint is displaced by some thousandths of a radian: its pre-sliding. Real friction lies
between both, and so does what is believed here:

    z += displacement / presliding, held within -1 ... 1                    (the stop operator)
    tau = stiction * K_theta_s * (z - s(theta_dot)), beside K_theta_s s(theta_dot) of (6)

In motion z = s(theta_dot) = +-1, and tau vanishes. What z was in the beginning is unknown: it is
followed from both ends, which meet once the joint was displaced far enough.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator import memory
from estimator.motor_position import LINK_REST

CREEP = 0.003
"""[rad/s]; a slower motor velocity may be noise and bias, and its integral nothing."""


def displacement(
    theta_dot: Vector, q_dot: Vector, moved: Vector, has_gap: NDArray[np.bool_], dt: Vector
) -> Vector:
    """Displacement (n,) [rad] over dt (n,) [s] of rotors whose position is not measured; `moved` is
    that of their links. Where both creep, rotor and link are taken for one, as they are where there
    is no gap: a link's encoder does not drift."""
    alone = (np.abs(theta_dot) > CREEP) | (np.abs(q_dot) > LINK_REST)
    turned: Vector = np.where(alone & has_gap, theta_dot * dt, moved)
    return turned


class Stiction:
    """z of each joint as an interval, `ends` (2, n); from -1 ... 1 on, where nothing is known.

    presliding [rad], > 0: from no friction to all of it.
    """

    _MEMORY = ("ends",)

    def __init__(self, n: int, presliding: float) -> None:
        self._per_presliding = 1.0 / presliding
        self.ends: Matrix = np.empty((2, n))
        self.restart()

    def restart(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget what the last motion left, of these joints or of all."""
        self.ends[0, joints], self.ends[1, joints] = -1.0, 1.0

    def step(self, displacement: Vector) -> None:
        """Move on by the rotor's displacement (n,) [rad]."""
        ends = self.ends
        ends += displacement * self._per_presliding
        np.minimum(np.maximum(ends, -1.0, out=ends), 1.0, out=ends)

    @property
    def z(self) -> Vector:
        """Share of the Coulomb friction that is held, signed as the motion that built it up."""
        middle: Vector = 0.5 * (self.ends[0] + self.ends[1])
        return middle

    @property
    def unknown(self) -> Vector:
        """Largest error of z: 1 where nothing is known, 0 after a motion."""
        half: Vector = 0.5 * (self.ends[1] - self.ends[0])
        return half

    def memory(self) -> dict[str, Any]:
        return memory.dump(self, self._MEMORY)

    def restore(self, state: dict[str, Any]) -> None:
        memory.load(self, self._MEMORY, state)
