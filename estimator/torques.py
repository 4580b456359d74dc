# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Torques and momenta of a joint at the common instant: the terms of (5), (6) and (7).

`residual` defines which of them act while engaged, and which in the gap.
"""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.elementary import smooth_sign
from estimator.dynamics import Dynamics
from estimator.interval import Interval
from estimator.stiction import Stiction
from estimator.transmission import Transmission

_MOMENTUM, _ROTOR, _THETA, _THETA_DOT, _BETA = range(5)  # rows of `interval.TERMS`
_TAU_M, _MOTOR_FRICTION, _ENGAGED_LINK_FRICTION, _LINK_FRICTION, _GAP_FRICTION = range(5, 10)
_STICTION = 10


class Torques:
    """Torque and momentum terms of all joints, from the parameters of their transmission; (n,)."""

    def __init__(
        self, dynamics: Dynamics, stiction: Stiction, interval: Interval, transmission: Transmission
    ) -> None:
        t = transmission
        self._dynamics, self._stiction, self._interval = dynamics, stiction, interval
        self.per_width = 1.0 / t.sign_width
        self.K_c, self._B = t.torque_constant.copy(), t.rotor_inertia.copy()
        self.alpha: Vector = t.half_gap.copy()
        self._motor_coulomb, self._motor_viscous = t.motor_coulomb.copy(), t.motor_viscous.copy()
        self._link_coulomb, self._link_viscous = t.link_coulomb.copy(), t.link_viscous.copy()
        self._gap_coulomb, self._gap_viscous = t.gap_coulomb.copy(), t.gap_viscous.copy()
        self.coulomb, self.viscous = t.engaged_coulomb.copy(), t.motor_viscous + t.link_viscous
        """of rotor and link moving as one [Nm], [Nm s/rad]"""
        self.load: Vector = t.load_friction.copy()
        """friction per transmitted torque"""
        self.payload: Vector = np.zeros(4)
        """what the last link carries: mass [kg], and position in its joint's frame [m]"""
        self._K_phi_p, self._K_phi_d = t.contact_stiffness.copy(), t.contact_damping.copy()

    def at(
        self, i: int, q_dot: float, theta_dot: float, theta: float, tau_M: float, turned: float
    ) -> None:
        """Write the terms of joint i to `interval.now`. turned: displacement of the rotor since the
        previous instant [rad]."""
        now = self._interval.now
        phi_dot = q_dot - theta_dot
        s_theta = smooth_sign(theta_dot * self.per_width)
        s_q = smooth_sign(q_dot * self.per_width)
        s_phi = smooth_sign(phi_dot * self.per_width)
        now[_MOMENTUM], now[_BETA] = self._dynamics.momentum[i], self._dynamics.beta[i]
        now[_ROTOR], now[_THETA], now[_THETA_DOT] = self._B[i] * theta_dot, theta, theta_dot
        now[_TAU_M] = tau_M
        now[_MOTOR_FRICTION] = self._motor_coulomb[i] * s_theta + self._motor_viscous[i] * theta_dot
        now[_ENGAGED_LINK_FRICTION] = (
            self._link_coulomb[i] * s_theta + self._link_viscous[i] * theta_dot
        )
        now[_LINK_FRICTION] = self._link_coulomb[i] * s_q + self._link_viscous[i] * q_dot
        now[_GAP_FRICTION] = self._gap_coulomb[i] * s_phi + self._gap_viscous[i] * phi_dot
        self._stiction.step(i, turned, s_theta)
        now[_STICTION] = self.coulomb[i] * self._stiction.held[i]

    def spring(self, i: int, phi: float, phi_dot: float) -> float:
        """Fitted correction of tau_M of joint i while engaged, by the penetration delta (5)
        [Nm]."""
        delta = phi - min(max(phi, -self.alpha[i]), self.alpha[i])
        return float(self._K_phi_p[i] * delta + self._K_phi_d[i] * phi_dot)

    def slides(self, i: int, theta_dot: float) -> float:
        """Direction, -1 to 1, in which the gear of joint i slides, or holds."""
        return float(smooth_sign(theta_dot * self.per_width) + self._stiction.held[i])

    def carry(self, payload: Vector, aligned: Matrix, going: NDArray[np.int64]) -> None:
        """Switch to another payload (4,): momentum and beta at the beginning of each interval
        become those of the new model. aligned: positions and velocities (2, n) there; going (n,): 1
        if begun."""
        change = 0.0
        for k in range(4):
            change += abs(payload[k] - self.payload[k])
        if change == 0.0:
            return  # keeps every bit
        self._count_momentum(aligned, going, -1.0)
        self.put_on(payload)
        self._count_momentum(aligned, going, 1.0)

    def put_on(self, payload: Vector) -> None:
        """Set the payload (4,), and leave the beginning of each interval as it is."""
        for k in range(4):
            self.payload[k] = payload[k]
        last = self._dynamics.n - 1
        self._dynamics.carry(last, payload[0], payload[1], payload[2], payload[3])

    def _count_momentum(self, aligned: Matrix, going: NDArray[np.int64], sign: float) -> None:
        """Add `sign` times the model's momentum and beta to the beginning of each interval."""
        begin, dynamics = self._interval.begin, self._dynamics
        dynamics.at(aligned[0], aligned[1])
        for i in range(dynamics.n):
            begin[_MOMENTUM, i] += sign * going[i] * dynamics.momentum[i]
            begin[_BETA, i] += sign * going[i] * dynamics.beta[i]
