"""Coulomb and viscous friction of every kind at its own velocity, (6), in one pass."""

import numpy as np

from arrays import Matrix, Vector
from estimator.interval import ROW
from estimator.transmission import Transmission, coulomb_viscous

FRICTIONS = slice(ROW["motor_friction"], ROW["gap_friction"] + 1)
"""Rows of an interval's terms: motor, link together with the motor, link alone, gap."""


class FrictionTerms:
    """Coulomb and viscous friction of a transmission, one row per term of FRICTIONS."""

    def __init__(self, transmission: Transmission) -> None:
        t = transmission
        self._coulomb = np.stack([t.motor_coulomb, t.link_coulomb, t.link_coulomb, t.gap_coulomb])
        self._viscous = np.stack([t.motor_viscous, t.link_viscous, t.link_viscous, t.gap_viscous])
        self._width = t.sign_width
        self._velocities: Matrix = np.zeros((4, t.n))

    def at(self, q_dot: Vector, theta_dot: Vector, out: Matrix) -> None:
        """Write friction into out (4, n) [Nm], positive along the velocity: motor at theta_dot,
        link at theta_dot, link at q_dot, gap at phi_dot; each (n,) [rad/s]."""
        v = self._velocities
        v[:2] = theta_dot
        v[2] = q_dot
        np.subtract(q_dot, theta_dot, out=v[3])
        out[:] = coulomb_viscous(self._coulomb, self._viscous, v, self._width)
