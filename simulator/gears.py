# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Imperfections of real gears: load-dependent friction, friction ripple over a turn, friction that
rises during rest, cogging, and a gap that varies over a turn.

The estimator models none of these terms, so that a simulated arm can be worse than its model.
Ordinary Python that also runs uncompiled; `gears.pxd` declares the C types (decision 0037).
"""

import numpy as np

from common.arrays import Vector
from common.elementary import sine, smooth_sign
from simulator.gear_settings import GearSettings

_STANDS = 0.005  # motor speed below which it counts as at rest [rad/s]
_PER_REVERSAL = 1.0 / 0.02  # inverse width of the transition from driving to driven [s/rad]
_RIPPLES, _COGS = 2.0, 12.0  # periods per turn
_RUN_IN_S = 20.0  # time constant, in motion, of the decay of friction raised by rest


class Gears:
    """Gears of n joints: call `update` once per step and joint, then the others for that instant.

    `active` is False if all settings are neutral: then no call is needed.
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
        """Present share of the friction rise after a long rest, per joint."""
        self.factor = np.ones((2, n))
        """Present friction of link and motor, relative to its mean in motion."""

    def update(self, i: int, q: float, theta: float, theta_dot: float) -> None:
        """Update the friction factors of joint i for this step."""
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
        """Coulomb friction at the motor due to the transmitted torque [Nm]: one share of it if the
        motor drives the link, another if the link drives the motor."""
        against = smooth_sign(theta_dot * _PER_REVERSAL) * gear_torque
        return float(self._mean_share * abs(gear_torque) - self._half_difference * against)

    def cog(self, i: int, theta: float) -> float:
        """Cogging torque on the motor of joint i [Nm]."""
        return float(self._cogging[i] * sine(_COGS * self._gear[i] * theta + self._cog_phase[i]))

    def half_gap(self, i: int, half_gap: float, q: float) -> float:
        """Half-gap of joint i at q [rad]; half_gap: its mean over a turn."""
        return float(half_gap * (1.0 + self._gap_ripple * sine(q + self._gap_phase[i])))
