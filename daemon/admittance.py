"""Admittance, eq. (15): the arm moves the way it is pushed, within bounds.

    q_dot_d = K_a r_bar,    tau q_ddot_d + q_dot_d = K_a r_bar   with a virtual mass

r_bar is the thresholded residual, from which the threshold is subtracted: at the threshold the
velocity starts from zero.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AdmittanceLaw:
    """Gains and bounds; `gain` and `velocity` of shape (n,)."""

    gain: Vector  # K_a [rad/s per Nm]
    virtual_mass_s: float  # tau, time constant of the velocity [s]
    velocity: Vector  # [rad/s]
    max_duration_s: float
    max_excursion: float  # [rad]

    def velocity_after(self, before: Vector, thresholded: Vector, dt: float) -> Vector:
        """Desired velocity [rad/s] one interval dt [s] after `before`, pushed by the thresholded
        residual [Nm]. Backward Euler: stable for every dt."""
        target = np.minimum(np.maximum(self.gain * thresholded, -self.velocity), self.velocity)
        share = dt / (self.virtual_mass_s + dt)
        velocity: Vector = before + share * (target - before)
        return velocity

    def bound_reached(self, elapsed_s: float, excursion: Vector) -> str:
        """Which bound ends this admittance, in words; empty while none does."""
        if elapsed_s > self.max_duration_s:
            return f"guided for more than {self.max_duration_s:g} s"
        if float(np.abs(excursion).max()) > self.max_excursion:
            return f"guided further than {self.max_excursion:g} rad"
        return ""
