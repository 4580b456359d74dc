# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Gears as they are built: friction that grows with the torque they transmit and ripples with the
turn, friction that a rest raises, cogging, and a gap that is not the same everywhere.

No model of the estimator has these terms, so that a simulated arm can be worse than it believes.
Ordinary Python, which runs as it is; `gears.pxd` names the types for the compiler, decision 0037.
"""

import numpy as np

from common.arrays import Vector
from common.elementary import sine, smooth_sign
from simulator.gear_settings import GearSettings

_STANDS = 0.005  # [rad/s]; below, a motor counts as standing
_PER_REVERSAL = 1.0 / 0.02  # [s/rad]; over which driving passes into being driven
_RIPPLES, _COGS = 2.0, 12.0  # times per turn
_RUN_IN_S = 20.0  # of motion, in which 1 / e is left of what a rest raised


class Gears:
    """Gears of n joints; `update` once a step and joint, then the others for the same instant.

    `active` is false where all settings are neutral: then nothing here needs to be called.
    """

    def __init__(
        self, settings: GearSettings, gear: Vector, rated_torque: Vector, step_s: float, seed: int
    ) -> None:
        """gear (n,): turns of the motor per turn of the joint; rated_torque (n,) [Nm]."""
        s = settings
        n = len(gear)
        rng = np.random.default_rng((seed, 5))
        self._motor_phase, self._link_phase, self._cog_phase, self._gap_phase = rng.uniform(
            0.0, 2.0 * np.pi, (4, n)
        )
        self.active = s != GearSettings()
        self._gear = np.array(gear, dtype=np.float64)
        self._mean_share = 0.5 * (s.load_driving + s.load_driven)
        self._half_difference = 0.5 * (s.load_driving - s.load_driven)
        self._ripple, self._gap_ripple = 0.01 * s.friction_ripple, 0.01 * s.gap_ripple
        self._cogging = 0.01 * s.cogging * np.array(rated_torque, dtype=np.float64)
        self._rise = s.rest_rise - 1.0
        self._sets = step_s / s.rest_s
        self._runs_in = step_s / _RUN_IN_S
        self.rested = np.zeros(n)
        """Share of the rise after a long rest that is there now, of each joint."""
        self.factor = np.ones((2, n))
        """Friction of link and motor at this instant, over what it is on average in motion."""

    def update(self, i: int, q: float, theta: float, theta_dot: float) -> None:
        """Friction of joint i in this step."""
        if abs(theta_dot) < _STANDS:
            self.rested[i] += self._sets * (1.0 - self.rested[i])
        else:
            self.rested[i] -= self._runs_in * self.rested[i]
        risen = 1.0 + self._rise * self.rested[i]
        motor_angle = _RIPPLES * self._gear[i] * theta + self._motor_phase[i]
        link_angle = _RIPPLES * q + self._link_phase[i]
        self.factor[0, i] = risen * (1.0 + self._ripple * sine(link_angle))
        self.factor[1, i] = risen * (1.0 + self._ripple * sine(motor_angle))

    def coulomb(self, gear_torque: float, theta_dot: float) -> float:
        """Coulomb friction that a transmitted torque causes at the motor [Nm]: one share of it
        where the motor drives the link, another where the link drives the motor."""
        against = smooth_sign(theta_dot * _PER_REVERSAL) * gear_torque
        return float(self._mean_share * abs(gear_torque) - self._half_difference * against)

    def cog(self, i: int, theta: float) -> float:
        """Torque of cogging on the motor of joint i [Nm]."""
        return float(self._cogging[i] * sine(_COGS * self._gear[i] * theta + self._cog_phase[i]))

    def half_gap(self, i: int, half_gap: float, q: float) -> float:
        """Half-gap of joint i at q [rad]; half_gap: its mean over a turn."""
        return float(half_gap * (1.0 + self._gap_ripple * sine(q + self._gap_phase[i])))
