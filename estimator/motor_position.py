# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Motor position in the gap: theta, its uncertainty, and the engaged side.

Theta integrates the motor velocity, or follows the drive's motor position. Either way its offset
from the link is found, and drift removed, by the geometry of the gap:

- |phi| never exceeds alpha and the gear's deflection;
- a torque transmitted for several ticks shows the side: phi < 0 pushes the link up, phi > 0 down;
- at standstill theta is held; a link that creeps meanwhile makes phi uncertain, as its rotor may or
  may not move along.

The side follows from the motor's side of the gear alone (current, friction, rotor inertia), never
from the residual: a hand that moves the link to the other border of its gap is observed, and not
explained away.
"""

from enum import IntEnum

import numpy as np

from estimator.settings import GapSettings
from estimator.transmission import LINK_REST, Transmission


class Side(IntEnum):
    """Gap state of a joint; LEFT is phi = -alpha, where the rotor pushes the link upwards."""

    LEFT = -1
    GAP = 0
    RIGHT = 1
    UNKNOWN = 2


# Distance from a border at which phi is clear of it, in standard uncertainties. A steady phi has to
# be further away: inside the gap the link would fall, so it probably rests on a misplaced border.
_CLEAR, _CLEAR_AT_REST = 1.3, 2.5
_RESTS_S, _RESTS_WITHIN = 0.3, 0.0005  # [rad]
_SKEW_S = 0.001  # unknown skew between the samples of link and motor
_PULL = 0.2  # share of the error at a border that is corrected per tick
_LEFT, _GAP, _RIGHT, _UNKNOWN = map(int, Side)


class MotorPosition:
    """Rotor positions of an arm: theta [rad], sigma [rad], `side` and the other state, each
    (n,)."""

    def __init__(self, transmission: Transmission, settings: GapSettings, measured: bool) -> None:
        s, t = settings, transmission
        self._alpha, self._coulomb = t.half_gap.copy(), t.motor_coulomb.copy()
        self._viscous = t.motor_viscous.copy()
        self._compliance = s.compliance * (t.half_gap > 0.0)
        # Friction of the motor's side relative to the identified one, and its relative error;
        # learning writes to both.
        self.friction, self.friction_error = np.ones(t.n), np.full(t.n, s.friction_error)
        self._rotor_error = s.rotor_error
        self._current_error, self._half_gap_error = s.current_error, s.half_gap_error
        self._margin, self._hysteresis = s.margin, s.hysteresis
        self._scale_error, self._bias = s.velocity_scale_error, s.velocity_bias
        self._standstill, self._hold_ticks, self._measured = s.standstill, s.hold_ticks, measured
        n = t.n
        self.theta, self.sigma, self.q = np.zeros((3, n))
        # How far the link has moved while theta was held, and the maximum of that [rad]; where phi
        # has been steady, and for how long [rad, s].
        self.slipped, self.slipped_most, self.rested_at, self.rested_s = np.zeros((4, n))
        # Streak: consecutive ticks in which the transmitted torque clearly had one sign, signed
        # likewise. Gap: certainly in the gap; unlike `side`, never unknown.
        self.side = np.zeros(n, dtype=np.int8)
        self.streak, self.gap = np.zeros((2, n), dtype=np.int64)
        for i in range(n):
            self.start(i, 0.0)

    def start(self, i: int, q: float) -> None:
        """Forget everything about joint i, except that phi is somewhere in the gap."""
        self.theta[i] = self.q[i] = q
        self.sigma[i] = self._alpha[i]
        self.side[i], self.streak[i], self.gap[i] = _UNKNOWN, 0, 0
        self.slipped[i] = self.slipped_most[i] = self.rested_at[i] = self.rested_s[i] = 0.0

    def step(
        self,
        i: int,
        dt: float,
        q: float,
        q_dot: float,
        theta_dot: float,
        resting: float,
        tau_M: float,
        advance: float,
        rotor: float,
        transmitted: float,
    ) -> bool:
        """Advance joint i by dt [s]; False if it was in its gap at both ends of that interval.

        q [rad], q_dot, theta_dot [rad/s], `transmission.resting` and tau_M [Nm] are those at its
        end; advance: change of theta, integrated or measured [rad]; rotor: mean B theta_ddot [Nm];
        transmitted: mean torque from the rotor to the link [Nm].
        """
        before = self.gap[i] != 0
        alpha, load, speed = self._alpha[i], abs(transmitted), abs(theta_dot)
        if self._measured:
            self.theta[i] += advance
        elif speed > self._standstill or abs(q_dot) > LINK_REST:
            self.theta[i] += advance
            self.sigma[i] += (self._scale_error * speed + self._bias) * dt
        else:
            self._hold(i, q - self.q[i])
        self.q[i] = q

        # Uncertainty of the transmitted torque; near rest friction may have any value. A torque
        # that may be friction shows nothing: neither the side, nor that there is a load.
        rubs = self.friction[i] * (self._coulomb[i] + self._viscous[i] * speed)
        doubt = self.friction_error[i] * rubs + self.friction[i] * self._coulomb[i] * resting
        doubt += self._rotor_error * abs(rotor) + self._current_error * abs(tau_M)
        if load <= doubt:
            self.streak[i] = 0
        elif transmitted > 0.0:
            self.streak[i] = max(self.streak[i], 0) + 1
        else:
            self.streak[i] = min(self.streak[i], 0) - 1
        engaged = abs(self.streak[i]) >= self._hold_ticks

        phi = self._correct(i, q, engaged, load * self._compliance[i])
        if abs(phi - self.rested_at[i]) > _RESTS_WITHIN:
            self.rested_at[i], self.rested_s[i] = phi, 0.0
        # The reference follows, so that phi counts as steady despite a drift below 2 mrad/s.
        self.rested_at[i] += (phi - self.rested_at[i]) * dt / _RESTS_S
        self.rested_s[i] += dt
        clearance = _CLEAR_AT_REST if self.rested_s[i] > _RESTS_S else _CLEAR
        doubtful = clearance * self.sigma[i] + _SKEW_S * speed
        border = alpha - max(self._margin * alpha, doubtful)
        # Hysteresis: to enter the gap, phi must be further inside than to stay there.
        if not self.gap[i]:
            border -= self._hysteresis
        clear = abs(phi) < border
        self.gap[i] = clear and load < doubt and not engaged
        if self.gap[i]:
            self.side[i] = _GAP
        elif not engaged and (self.sigma[i] >= alpha > 0.0 or clear):
            # The position is unknown, or a new load contradicts it.
            self.side[i] = _UNKNOWN
        elif engaged or alpha == 0.0:
            self.side[i] = _LEFT if transmitted > 0.0 else _RIGHT
        else:
            self.side[i] = _LEFT if phi < 0.0 else _RIGHT
        return not (before and self.gap[i])

    def contradicted(self, i: int, theta_dot: float) -> bool:
        """True if joint i is believed in its gap, but its link has followed the rotor for more than
        the gap's width: it is carried by a border, which must be elsewhere. theta_dot [rad/s]."""
        follows = self.rested_s[i] * abs(theta_dot) > 2.0 * self._alpha[i]
        return bool(self.gap[i] != 0 and follows)

    def _hold(self, i: int, moved: float) -> None:
        """Hold theta at standstill. A link that creeps may take its rotor along, or be moved by a
        hand while the rotor stands: phi becomes as uncertain as the link's net creep. Motion back
        and forth, like that of encoder counts, adds nothing."""
        self.slipped[i] += moved
        most = abs(self.slipped[i])
        if most > self.slipped_most[i]:
            self.sigma[i] += most - self.slipped_most[i]
            self.slipped_most[i] = most

    def _correct(self, i: int, q: float, engaged: bool, bent: float) -> float:
        """Move theta so that phi = q - theta is possible, and return phi: at its border while
        engaged, and never beyond the deflection `bent` of the gear under load."""
        alpha, phi = self._alpha[i], q - self.theta[i]
        # A positive torque acts at the lower border of phi, a negative one at the upper.
        border = -1.0 if self.streak[i] > 0 else 1.0
        outward = border * phi
        lowest = alpha if engaged else -(alpha + bent)
        error = border * (outward - min(max(outward, lowest), alpha + bent))
        if engaged:
            # An unknown position is corrected at once, a known one gradually.
            pull = _PULL if self.sigma[i] < alpha else 1.0
            error *= pull
            self.sigma[i] = min(self.sigma[i], alpha)
            self.sigma[i] += pull * (
                min(self._half_gap_error * alpha + bent, alpha) - self.sigma[i]
            )
            self.slipped[i] = self.slipped_most[i] = 0.0
        elif self.sigma[i] > alpha:
            self.sigma[i] = alpha
        self.theta[i] += error
        phi -= error
        return float(phi)
