# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Impulses over one interval of each joint, from the values at both of its ends.

Momenta enter as increments; torques and velocities are integrated by Tustin's rule, the mean of
both ends.

The interval of a joint without a sample keeps its beginning and lasts until the next sample:
nothing that happens meanwhile is lost, or counted twice.
"""

import numpy as np

# Quantities at an instant, one row each; increments first. For kinds of friction see `residual`.
TERMS = (
    "momentum",  # M q_dot [kg m2/s]
    "rotor",  # B theta_dot [kg m2/s]
    "theta",  # [rad], if it is measured
    "theta_dot",  # [rad/s]
    "beta",  # C^T q_dot - g [Nm]
    "tau_M",  # [Nm]
    "motor_friction",  # friction of the motor's side at theta_dot [Nm]
    "engaged_link_friction",  # friction of the link's side at theta_dot: rotor and link move as one
    "link_friction",  # friction of the link's side at q_dot
    "gap_friction",  # friction between rotor and link at phi_dot
    "stiction",  # held near rest, in addition to motor_friction and engaged_link_friction
)
ROW = {name: row for row, name in enumerate(TERMS)}
_TERMS, _INCREMENTS = len(TERMS), ROW["theta_dot"]


class Interval:
    """Impulses of one joint at a time: the caller writes the values of an instant to `now`
    (TERMS,), and reads `impulse` (TERMS,). `begin` (TERMS, n): values at the beginning of each
    interval."""

    def __init__(self, n: int) -> None:
        self.begin = np.zeros((_TERMS, n))
        self.now, self.impulse = np.zeros((2, _TERMS))

    def integrate(self, i: int, dt: float) -> None:
        """Compute the impulses of joint i over its interval of dt [s] that ends now: the integrals
        of (12), by Tustin's rule as in (13)."""
        for row in range(_TERMS):
            if row < _INCREMENTS:
                self.impulse[row] = self.now[row] - self.begin[row, i]
            else:
                self.impulse[row] = 0.5 * dt * (self.now[row] + self.begin[row, i])

    def end(self, i: int) -> None:
        """Begin the next interval of joint i, with the present values."""
        for row in range(_TERMS):
            self.begin[row, i] = self.now[row]

    def restart(self, i: int) -> None:
        """Clear the beginning of the interval of joint i."""
        for row in range(_TERMS):
            self.begin[row, i] = 0.0
