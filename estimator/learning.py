# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Learning of friction during operation: small corrections of the identified parameters.

Most of a residual without a contact is friction error:

    r = w1 c + w2 v + w3 l + b + noise

c, v: Coulomb and viscous friction of the model; l: transmitted torque, signed by the motion; each
filtered like r by (13). w3 here is the negative of that in docs/estimator.md.

A Kalman filter tracks the shares w, which drift over minutes, and the bias b, which drifts over
seconds. w1 c + w2 v + w3 l is subtracted from the residual. b, the torque of mass errors as well as
of a hand that leans on the arm, never is: friction changes sign with the motion, a hand does not.
During a contact, and for a moment after the residual was far from its prediction, only b is
updated; at rest and inside a gap nothing is, and over hours of rest knowledge fades. Near rest,
where friction may have any value, measurements weigh less. No share leaves its bounds.

Friction that is not known yet raises the levels: `unknown` is the torque that a friction error of
_OFF would cause, reduced as the joint shows its friction. Known friction lowers them: the corrected
residual shows the level that its joint needs (`needed_level`).
"""

from math import sqrt

import numpy as np

from common.arrays import Vector
from estimator.needed_level import NeededLevel
from estimator.thresholds import Thresholds

# States of the filter, and their time constants of forgetting [s], in motion except for b.
_CONSTANT, _VISCOUS, _COULOMB, _LOAD, _COLUMNS = 0, 1, 2, 3, 4
_FORGETS_S = (10.0, 600.0, 600.0, 600.0)
# Prior standard deviation of each state, for b as a share of the contact level; and that of the
# noise, likewise, which is correlated over _NOISE_S.
_SPREAD, _NOISE, _NOISE_S = (0.4, 0.4, 0.4, 0.1), 0.2, 0.1
# Bounds of each state: friction may be 0.3 to 2.2 times the identified value.
_MOST, _LEAST = (1e9, 0.7, 0.7, 0.0), (-1e9, -1.2, -1.2, -0.5)
# Relative error of identified friction before anything was learned, and the one that always
# remains: friction depends on load and pose.
_OFF, _REMAINS = 0.5, 0.15
# Load friction assumed where learning is in doubt, in standard deviations; and relative error of
# the learned load friction.
_LOAD_SPREADS, _LOAD_OFF = 2.0, 0.3
# No share is learned for _FROZEN_S after the residual differed from its prediction by more than the
# share _FREEZES of the level in force; by _THAWS, once friction was found to have changed.
_FREEZES, _THAWS, _FROZEN_S = 0.5, 0.9, 0.3
# A gear at rest for _STANDS_S cools: its friction is then forgotten at 1 / _RESTING of the rate.
_STANDS_S, _RESTING = 60.0, 12.0
# Doubt in what was learned from which on residuals do not show the needed level.
_DOUBTED = 0.1
# Friction is being relearned while it differs by the share _RELEARNS of the level from its mean
# over _SETTLES_S of motion.
_RELEARNS, _SETTLES_S = 0.05, 10.0


class Learning:
    """Friction shares of all joints; `correction` and `unknown` (n,) [Nm]."""

    def __init__(
        self, thresholds: Thresholds, load_friction: Vector, load_friction_error: Vector
    ) -> None:
        """thresholds: configured contact levels, and the least share of each that remains;
        load_friction, load_friction_error (n,): see `Transmission`."""
        contact = thresholds.contact
        n = len(contact)
        self.needed = NeededLevel(thresholds.least_share)
        spread = np.repeat(_SPREAD, n).reshape(_COLUMNS, n)
        spread[_CONSTANT] *= contact
        known = load_friction_error > 0.0
        spread[_LOAD, known] = load_friction_error[known]
        # Load friction assumed where learning is in doubt.
        self._load_may_be: Vector = _LOAD_SPREADS * spread[_LOAD]
        self._load_error: Vector = load_friction_error.copy()
        self._variance = spread**2  # (columns, n)
        self._noise = (_NOISE * contact) ** 2 * _NOISE_S
        lowest, highest = (np.repeat(one, n).reshape(_COLUMNS, n) for one in (_LEAST, _MOST))
        lowest[_LOAD] += load_friction
        highest[_LOAD] += load_friction
        self._lowest, self._highest = lowest, highest
        self._forgets_s = np.array(_FORGETS_S)
        # Filtered regressors of each joint's residual, and their estimated shares with covariance.
        self.columns, self.shares = np.zeros((2, n, _COLUMNS))
        self.covariance = np.zeros((n, _COLUMNS, _COLUMNS))
        # Remaining standard deviation of both kinds of friction, relative to the prior one.
        self.coulomb_left, self.viscous_left = np.ones((2, n))
        self.calm_s, self.still_s = np.zeros((2, n))
        self.correction, self.unknown = np.zeros((2, n))
        self.settled = np.zeros(n)  # share of Coulomb friction, smoothed
        self._x = np.zeros(_COLUMNS)
        for i in range(n):
            self._forget(i)

    def reset(self, i: int) -> None:
        """Restart from r = 0; what was learned of joint i is kept."""
        for k in range(_COLUMNS):
            self.columns[i, k] = 0.0
        self.correction[i] = self.unknown[i] = 0.0
        self.calm_s[i] = 0.0
        self.needed.reset(i)

    def friction(self, i: int) -> float:
        """Friction of joint i relative to the identified one."""
        return 1.0 - float(self.shares[i, _COULOMB])

    def load(self, i: int) -> float:
        """Friction of joint i per transmitted torque, beyond the identified one."""
        return -float(self.shares[i, _LOAD])

    def error(self, i: int) -> float:
        """Relative error that the friction of joint i may still have."""
        return _REMAINS + _OFF * float(self.coulomb_left[i])

    def unknown_at(self, i: int, coulomb: float, viscous: float, load: float) -> float:
        """Uncertainty [Nm] of these Coulomb and viscous parts; load: transmitted torque [Nm]."""
        learned = _LOAD_OFF * abs(self.shares[i, _LOAD])
        of_load = max(learned, self._load_error[i] * self._left(i, _LOAD))
        own = self.viscous_left[i] * abs(viscous) + self.coulomb_left[i] * abs(coulomb)
        return float(_OFF * own + of_load * abs(load))

    def doubted_at(self, i: int, doubt: float) -> float:
        """Uncertainty [Nm] of the present friction of joint i, at a doubt in learning of 0 to 1."""
        load = self._load_may_be[i] * abs(self.columns[i, _LOAD])
        return float(doubt * (_OFF * self.identified(i) + load))

    def stood(self, i: int) -> bool:
        """True if joint i has been at rest so long that its gear cools."""
        return bool(self.still_s[i] > _STANDS_S)

    def identified(self, i: int) -> float:
        """Magnitude of the identified friction of joint i, filtered like r [Nm]."""
        return float(abs(self.columns[i, _VISCOUS]) + abs(self.columns[i, _COULOMB]))

    def reset_uncertainty(self, i: int) -> None:
        """Reset the uncertainty of friction to the prior one, but keep its estimate for now."""
        for k in range(_VISCOUS, _COLUMNS):
            for m in range(_COLUMNS):
                self.covariance[i, k, m] = self.covariance[i, m, k] = 0.0
            self.covariance[i, k, k] = self._variance[k, i]
        self._say_what_is_left(i)

    def give_up(self, i: int) -> None:
        """Return to the identified friction."""
        self.shares[i, _VISCOUS] = self.shares[i, _COULOMB] = self.shares[i, _LOAD] = 0.0
        self.correction[i] = 0.0

    def step(
        self, i: int, coulomb: float, viscous: float, load: float, dt: float, pole: float,
        share: float,
    ) -> None:  # fmt: skip
        """Take the impulses [Nm s] of joint i over its interval of dt [s], filtered by `pole` and
        `share` of (13); impulses that do not act on the link are 0."""
        constant = pole * self.columns[i, _CONSTANT] + share * dt
        viscous = pole * self.columns[i, _VISCOUS] + share * viscous
        coulomb = pole * self.columns[i, _COULOMB] + share * coulomb
        self.columns[i, _CONSTANT] = constant
        load = pole * self.columns[i, _LOAD] + share * load
        self.columns[i, _VISCOUS], self.columns[i, _COULOMB] = viscous, coulomb
        self.columns[i, _LOAD] = load
        self.correction[i] = (
            self.shares[i, _VISCOUS] * viscous
            + self.shares[i, _COULOMB] * coulomb
            + self.shares[i, _LOAD] * load
        )
        self.unknown[i] = self.unknown_at(i, coulomb, viscous, load)

    def learn(
        self, i: int, residual: float, level: float, configured: float, friction: float,
        raised: float, doubt: float, rubs: bool, moving: bool, suspended: bool, dt: float,
    ) -> None:  # fmt: skip
        """Learn from joint i, unless something may be touching it. residual: before its correction;
        level, configured: contact levels; friction, raised: parts of the level in force for
        friction near rest and for transients [Nm]; doubt: in what was learned, 0 to 1;
        rubs: friction was found to have changed; moving: the joint moves, engaged; suspended:
        nothing is learned, but a joint at rest cools."""
        self.still_s[i] = 0.0 if moving else self.still_s[i] + dt
        if self.stood(i):
            self._rest(i, dt)
        if suspended:
            self.calm_s[i] = 0.0
            return
        corrected = residual - self.correction[i]
        size = abs(corrected)
        if doubt < _DOUBTED:
            self.needed.note(
                i, corrected, level, configured, self.unknown[i], friction, raised,
                self._relearns(i, configured), moving, dt,
            )  # fmt: skip
        freezes = _THAWS if rubs else _FREEZES
        b = self.shares[i, _CONSTANT] * self.columns[i, _CONSTANT]
        surprise = abs(residual - self.correction[i] - b)
        calm = surprise <= freezes * level and size <= level  # false for NaN
        self.calm_s[i] = self.calm_s[i] + dt if calm else 0.0
        self._drift(i, _CONSTANT, dt)
        if moving:
            known = self.calm_s[i] > _FROZEN_S
            if known:
                self._drift(i, _VISCOUS, dt)
                self._drift(i, _COULOMB, dt)
                self._drift(i, _LOAD, dt)
            self._follow(i, residual, friction + raised, dt, known)
            self.settled[i] += dt / _SETTLES_S * (self.shares[i, _COULOMB] - self.settled[i])

    def _relearns(self, i: int, configured: float) -> bool:
        """True while friction of joint i is being relearned."""
        moved = abs(self.shares[i, _COULOMB] - self.settled[i]) * abs(self.columns[i, _COULOMB])
        return bool(moved > _RELEARNS * configured)

    def _rest(self, i: int, dt: float) -> None:
        """Let knowledge of joint i fade over dt [s] of rest."""
        self._drift(i, _VISCOUS, dt / _RESTING)
        self._drift(i, _COULOMB, dt / _RESTING)
        self._drift(i, _LOAD, dt / _RESTING)
        self._say_what_is_left(i)
        self.needed.rest(i, dt)

    def _drift(self, i: int, column: int, dt: float) -> None:
        """Let one state of joint i fade over dt [s]: an Ornstein-Uhlenbeck process."""
        fade = dt / self._forgets_s[column]
        self.shares[i, column] -= fade * self.shares[i, column]
        for k in range(_COLUMNS):
            self.covariance[i, column, k] -= fade * self.covariance[i, column, k]
            self.covariance[i, k, column] -= fade * self.covariance[i, k, column]
        self.covariance[i, column, column] += 2.0 * fade * self._variance[column, i]

    def _follow(self, i: int, residual: float, doubt: float, dt: float, known: bool) -> None:
        """Update all states of joint i by a residual before its correction [Nm]; where a touch
        cannot be excluded, b alone (Schmidt-Kalman filter, which considers the others)."""
        variance, error = (self._noise[i] + doubt * doubt * _NOISE_S) / dt, residual
        for k in range(_COLUMNS):
            self._x[k] = 0.0
            for m in range(_COLUMNS):
                self._x[k] += self.covariance[i, k, m] * self.columns[i, m]
            variance += self.columns[i, k] * self._x[k]
            error -= self.columns[i, k] * self.shares[i, k]
        if not 0.0 < variance < 1e300 or not abs(error) < 1e150:
            self._forget(i)
            return
        for k in range(_COLUMNS):
            gain_k = self._x[k] / variance if known or k == _CONSTANT else 0.0
            self.shares[i, k] = min(
                max(self.shares[i, k] + gain_k * error, self._lowest[k, i]), self._highest[k, i]
            )
            for m in range(_COLUMNS):
                gain_m = self._x[m] / variance if known or m == _CONSTANT else 0.0
                self.covariance[i, k, m] -= (
                    gain_k * self._x[m] + self._x[k] * gain_m
                ) - gain_k * gain_m * variance
        self._say_what_is_left(i)

    def _say_what_is_left(self, i: int) -> None:
        self.coulomb_left[i] = self._left(i, _COULOMB)
        self.viscous_left[i] = self._left(i, _VISCOUS)

    def _left(self, i: int, column: int) -> float:
        """Standard deviation of a state, relative to the prior one."""
        left = self.covariance[i, column, column] / self._variance[column, i]
        return sqrt(min(max(left, 0.0), 1.0))

    def _forget(self, i: int) -> None:
        """Reset the states of joint i to the prior."""
        for k in range(_COLUMNS):
            for m in range(_COLUMNS):
                self.covariance[i, k, m] = self._variance[k, i] if k == m else 0.0
            self.shares[i, k] = 0.0
        self.coulomb_left[i] = self.viscous_left[i] = 1.0
