# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Levels in force: the residual that each joint may show without a contact.

    level = k (level configured + per_speed |theta_dot| + unlearned) + friction + raise

k is the learned factor on the configured level, 0.2 to 1, and 1 before anything was learned;
unlearned is the torque that friction may cause until it is learned. Both come from `learning`.
friction is the torque that may be wrong near rest and at reversals: what stiction may hold, and
`stiction_share` of Coulomb friction. It passes the filter (13) of the residual, so that it covers
exactly what r still shows of it. raise covers transients: the crossing of a gap, an unknown side,
missing samples; it decays at half the gain of r.
"""

import numpy as np

from common.elementary import decay
from common.errors import ModelError
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

# Raise per missing sample beyond the first, and at most, as shares of the contact level: the error
# of the mean of both ends over an interval in which a motor crossed its gap.
_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
# Share of the contact level needed for the shock of another joint that leaves its gap.
_SHAKEN_SHARE = 0.6


class Levels:
    """Levels in force: `contact`, `collision`, and `above`, which is added to k times the
    configured contact level; (n,) [Nm].

    Raises ModelError for thresholds of another number of joints.
    """

    def __init__(
        self, transmission: Transmission, thresholds: Thresholds, settings: EstimatorSettings
    ) -> None:
        n, s, t = transmission.n, settings, transmission
        if thresholds.contact.shape != (n,):
            raise ModelError(f"thresholds for {thresholds.contact.size} joints, the arm has {n}")
        self._gain, self._at_rest = s.gain, s.stiction_share
        self._contact, self._collision = thresholds.contact.copy(), thresholds.collision.copy()
        self._per_speed = thresholds.per_speed.copy()
        self._coulomb, self._has_gap = t.engaged_coulomb.copy(), 1.0 * (t.half_gap > 0.0)
        self._unknown_side_share = s.unknown_side_share
        self.share, self.crossing = np.ones((2, n))  # k, and its value while a gap is crossed
        self.contact, self.collision, self.above = np.zeros((3, n))
        # Friction at the beginning of each interval; filtered friction; raise [Nm].
        self.begin, self.friction, self.raised = np.zeros((3, n))
        self._now = 0.0

    def set_friction(self, i: int, rest: float, unknown: float, factor: float, load: float) -> None:
        """Set the friction of joint i that may be wrong now. rest: `transmission.resting`; unknown:
        share of Coulomb friction; factor: friction over the identified one; load: load friction
        [Nm]."""
        self._now = self.friction_at(i, rest, unknown, factor, load)

    def friction_at(self, i: int, rest: float, unknown: float, factor: float, load: float) -> float:
        """Friction of joint i that may be wrong [Nm], arguments as above. `stiction_share` fades
        at half the velocity of `rest`."""
        rest *= rest
        rest *= rest
        coulomb = self._coulomb[i] * factor + load
        return float(coulomb * (unknown + self._at_rest * rest))

    def integrate(self, i: int, dt: float, pole: float, share: float) -> None:
        """Filter the friction over the interval of dt [s] that ends now, by `pole` and `share` of
        (13)."""
        impulse = 0.5 * dt * (self._now + self.begin[i])
        self.friction[i] = pole * self.friction[i] + share * impulse

    def end(self, i: int) -> None:
        """Begin the next interval of joint i, with the present friction."""
        self.begin[i] = self._now

    def uncertainty(
        self, i: int, unknown: bool, crossing: bool, shaken: bool, periods: float
    ) -> float:
        """Torque [Nm] that joint i may appear to show while the side of its gap is unknown or it
        crosses the gap, while another joint that leaves its gap shakes it, and after missing
        samples; periods: since the previous sample."""
        needed = _SHAKEN_SHARE if shaken else 0.0
        if crossing:
            needed = max(needed, self.crossing[i] * self._has_gap[i])
        share = max(needed - self.share[i], 0.0)
        if unknown:
            share += self._unknown_side_share * self._has_gap[i]
        missing = max(periods - 2.0, 0.0)
        share += min(missing * _MISSING_SHARE, _MISSING_MOST)
        return float(share * self._contact[i])

    def put_in_force(
        self, i: int, learning: float, uncertainty: float, speed: float, dt: float
    ) -> float:
        """Update the levels of joint i for this tick; returns the contact level [Nm]. learning:
        torque of friction that is not yet learned [Nm]; uncertainty: as above; speed: of the motor
        [rad/s]."""
        self.raised[i] = max(self.raised[i] * decay(0.5 * self._gain * dt), uncertainty)
        self.add_up(i, learning, speed)
        self.contact[i] = self.contact_at(i, self.above[i])
        grown = self._per_speed[i] * speed
        self.collision[i] = (
            self._collision[i] + grown + self.share[i] * learning
            + self.friction[i] + self.raised[i]
        )  # fmt: skip
        return float(self.contact[i])

    def add_up(self, i: int, learning: float, speed: float) -> None:
        """Sum what is added to k times the configured contact level."""
        grown = self._per_speed[i] * speed + learning
        self.above[i] = self.raised[i] + self.friction[i] + self.share[i] * grown

    def contact_at(self, i: int, above: float) -> float:
        """Contact level of joint i [Nm], given what is `above` k times the configured one [Nm]."""
        return float(self.share[i] * self._contact[i] + above)

    def configured(self, i: int, speed: float) -> float:
        """Configured contact level of joint i at a motor speed [Nm]."""
        return float(self._contact[i] + self._per_speed[i] * speed)

    def reset(self, i: int) -> None:
        """Restart from r = 0."""
        self.friction[i] = self.raised[i] = 0.0
