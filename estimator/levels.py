# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Levels in force: what a residual may show of each joint without a contact.

    level = k (level configured + per_speed |theta_dot| + unlearned) + friction + raise

k is the learned factor on the configured level, 0.2 to 1, and 1 before anything was learned;
unlearned is what friction may make until it was learned, and comes from `learning`, as k does.
Friction is the torque that may be off near rest, and at a turn: what stiction may hold, and
`stiction_share` of it all. It passes the filter (13) of the residual, so that it covers what r
still shows of it, and no more. `raise` is for what lasts a moment: a gap that is crossed, a side
that is not known, samples that were missing; it fades with half the gain of r.
"""

import numpy as np

from common.elementary import decay
from common.errors import ModelError
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission

# Of the contact level, for each sample that was missing beyond the first, and at most: what the
# mean of both ends may be wrong by over an interval in which a motor crossed its gap.
_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
# Share of the contact level that the shock needs with which another joint lands in its gear.
_SHAKEN_SHARE = 0.6


class Levels:
    """`contact` and `collision` in force, and `above`, what is added to k times the configured
    contact level; (n,) [Nm].

    Raises ModelError for thresholds of another arm.
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
        self._unsure = s.unknown_side_share
        self.share, self.crossing = np.ones((2, n))  # k, and what it is while a gap is crossed
        self.contact, self.collision, self.above = np.zeros((3, n))
        # Friction at the beginning of each interval, and filtered; what fades [Nm].
        self.begin, self.friction, self.raised = np.zeros((3, n))
        self._now = 0.0

    def rub(self, i: int, rest: float, unknown: float, factor: float, load: float) -> None:
        """Set the friction of joint i that may be off now. rest: `transmission.resting`; unknown:
        share of its Coulomb friction; factor: its friction over that which was identified; load:
        friction of what its gear transmits [Nm]."""
        self._now = self.friction_at(i, rest, unknown, factor, load)

    def friction_at(self, i: int, rest: float, unknown: float, factor: float, load: float) -> float:
        """Friction of joint i that may be off [Nm], as `rub` takes it. `stiction_share` counts at
        half the velocity up to which a joint rests."""
        rest *= rest
        rest *= rest
        coulomb = self._coulomb[i] * factor + load
        return float(coulomb * (unknown + self._at_rest * rest))

    def integrate(self, i: int, dt: float, pole: float, share: float) -> None:
        """Filter it over the interval of dt [s] that ends now, by `pole` and `share` of (13)."""
        impulse = 0.5 * dt * (self._now + self.begin[i])
        self.friction[i] = pole * self.friction[i] + share * impulse

    def end(self, i: int) -> None:
        """Begin the next interval of joint i, with the friction of now."""
        self.begin[i] = self._now

    def unsure(self, i: int, unknown: bool, crossing: bool, shaken: bool, periods: float) -> float:
        """Torque [Nm] that joint i may pretend while the side of its gap is unknown or it crosses
        it, while another joint's landing shakes it, and after samples that were missing; periods:
        since the sample before."""
        needed = _SHAKEN_SHARE if shaken else 0.0
        if crossing:
            needed = max(needed, self.crossing[i] * self._has_gap[i])
        share = max(needed - self.share[i], 0.0)
        if unknown:
            share += self._unsure * self._has_gap[i]
        missing = max(periods - 2.0, 0.0)
        share += min(missing * _MISSING_SHARE, _MISSING_MOST)
        return float(share * self._contact[i])

    def put_in_force(
        self, i: int, learning: float, unsure: float, speed: float, dt: float
    ) -> float:
        """Levels of joint i for this tick; returns that of contact [Nm]. learning: what is not yet
        learned may make [Nm]; unsure: as above; speed: of the motor [rad/s]."""
        self.raised[i] = max(self.raised[i] * decay(0.5 * self._gain * dt), unsure)
        self.add_up(i, learning, speed)
        self.contact[i] = self.contact_at(i, self.above[i])
        grown = self._per_speed[i] * speed
        self.collision[i] = (
            self._collision[i] + grown + self.share[i] * learning
            + self.friction[i] + self.raised[i]
        )  # fmt: skip
        return float(self.contact[i])

    def add_up(self, i: int, learning: float, speed: float) -> None:
        """Put together what is above k times the contact level."""
        grown = self._per_speed[i] * speed + learning
        self.above[i] = self.raised[i] + self.friction[i] + self.share[i] * grown

    def contact_at(self, i: int, above: float) -> float:
        """Contact level of joint i [Nm] with so much above k times the configured one [Nm]."""
        return float(self.share[i] * self._contact[i] + above)

    def usual(self, i: int, speed: float) -> float:
        """Configured contact level of joint i at a motor speed [Nm]."""
        return float(self._contact[i] + self._per_speed[i] * speed)

    def reset(self, i: int) -> None:
        """Begin with r = 0 anew."""
        self.friction[i] = self.raised[i] = 0.0
