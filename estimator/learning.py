# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Learning of friction while the arm works: small corrections of what was identified.

What a residual shows while nothing touches is in good part friction that is off:

    r = w1 c + w2 v + w3 l + b + noise

c, v: Coulomb and viscous friction of the model; l: torque that the gear transmits, by the sign of
its motion; each filtered as r is by (13). w3 here is minus that of docs/estimator.md.

A Kalman filter follows the shares w, which drift in minutes, and b, which drifts in seconds. w1 c +
w2 v + w3 l is taken off the residual; b, the torque of a hand that leans on the arm as well as of
masses that are off, never is: friction turns with the motion, and a hand does not. While a contact
is on, and for a moment after the residual was far from what these make of it, only b is followed;
at rest and inside a gap, nothing, and in hours of rest what is known fades. Near rest, where
friction may be anything, what shows is believed less. No share goes beyond its bound.

What is not known yet raises the levels: `unknown` is the torque that friction, wrong by _OFF,
would make there, reduced as the joint shows its friction. What is known sinks them: the corrected
residual shows what level its joint needs (`needed_level`).
"""

from math import sqrt

import numpy as np

from common.arrays import Vector
from estimator.needed_level import NeededLevel
from estimator.thresholds import Thresholds

# What is followed; and how long each is remembered [s], of motion but for b.
_CONSTANT, _VISCOUS, _COULOMB, _LOAD, _COLUMNS = 0, 1, 2, 3, 4
_FORGETS_S = (10.0, 600.0, 600.0, 600.0)
# Standard deviation of each, that of b of the contact level; and of what is neither, which lasts
# _NOISE_S.
_SPREAD, _NOISE, _NOISE_S = (0.4, 0.4, 0.4, 0.1), 0.2, 0.1
# Largest share of each, and least: friction may be 0.3 to 2.2 times what was identified.
_MOST, _LEAST = (1e9, 0.7, 0.7, 0.0), (-1e9, -1.2, -1.2, -0.5)
# Share by which friction that was identified may be off before anything is learned, and that which
# remains however much was: it depends on load and pose.
_OFF, _REMAINS = 0.5, 0.15
# Standard deviations of friction per transmitted torque that may be there where learning is in
# doubt; and share of the learned one that may be off.
_LOAD_SPREADS, _LOAD_OFF = 2.0, 0.3
# For _FROZEN_S after the residual was further than this share of the level in force from what is
# expected, no share is learned. Where friction was seen to be another, up to _THAWS of it teach.
_FREEZES, _THAWS, _FROZEN_S = 0.5, 0.9, 0.3
# A gear that has stood for _STANDS_S cools down: its friction is forgotten _RESTING times as slowly
# as in motion.
_STANDS_S, _RESTING = 60.0, 12.0
# Nothing shows what level is needed while so much of what was learned is in doubt.
_DOUBTED = 0.1
# Friction is learned anew while it is so much of its level from where it was in so much motion
# before [s].
_RELEARNS, _SETTLES_S = 0.05, 10.0


class Learning:
    """Shares of an arm's joints; `correction` and `unknown` (n,) [Nm]."""

    def __init__(
        self, thresholds: Thresholds, load_friction: Vector, load_friction_error: Vector
    ) -> None:
        """thresholds: the configured contact levels, and what of each must be left; load_friction,
        load_friction_error (n,): see `Transmission`."""
        contact = thresholds.contact
        n = len(contact)
        self.needed = NeededLevel(thresholds.least_share)
        spread = np.repeat(_SPREAD, n).reshape(_COLUMNS, n)
        spread[_CONSTANT] *= contact
        known = load_friction_error > 0.0
        spread[_LOAD, known] = load_friction_error[known]
        # Friction per transmitted torque that may be there where learning is in doubt.
        self._load_may_be: Vector = _LOAD_SPREADS * spread[_LOAD]
        self._load_error: Vector = load_friction_error.copy()
        self._variance = spread**2  # (columns, n)
        self._noise = (_NOISE * contact) ** 2 * _NOISE_S
        lowest, highest = (np.repeat(one, n).reshape(_COLUMNS, n) for one in (_LEAST, _MOST))
        lowest[_LOAD] += load_friction
        highest[_LOAD] += load_friction
        self._lowest, self._highest = lowest, highest
        self._forgets_s = np.array(_FORGETS_S)
        # Of what each joint's residual is made of now, filtered; and what is known of it.
        self.columns, self.shares = np.zeros((2, n, _COLUMNS))
        self.covariance = np.zeros((n, _COLUMNS, _COLUMNS))
        # Of the standard deviation of both kinds of friction before anything was learned.
        self.coulomb_left, self.viscous_left = np.ones((2, n))
        self.calm_s, self.still_s = np.zeros((2, n))
        self.correction, self.unknown = np.zeros((2, n))
        self.settled = np.zeros(n)  # share of Coulomb friction, smoothed
        self._x = np.zeros(_COLUMNS)
        for i in range(n):
            self._forget(i)

    def reset(self, i: int) -> None:
        """Begin with r = 0 anew; what was learned of joint i stays."""
        for k in range(_COLUMNS):
            self.columns[i, k] = 0.0
        self.correction[i] = self.unknown[i] = 0.0
        self.calm_s[i] = 0.0
        self.needed.reset(i)

    def friction(self, i: int) -> float:
        """Friction of joint i over what was identified."""
        return 1.0 - float(self.shares[i, _COULOMB])

    def load(self, i: int) -> float:
        """Friction of joint i per torque that its gear transmits, beyond the identified one."""
        return -float(self.shares[i, _LOAD])

    def error(self, i: int) -> float:
        """Share by which the friction of joint i may still be off."""
        return _REMAINS + _OFF * float(self.coulomb_left[i])

    def unknown_at(self, i: int, coulomb: float, viscous: float, load: float) -> float:
        """Uncertainty of such friction of joint i [Nm]; load: torque that its gear transmits."""
        learned = _LOAD_OFF * abs(self.shares[i, _LOAD])
        of_load = max(learned, self._load_error[i] * self._left(i, _LOAD))
        own = self.viscous_left[i] * abs(viscous) + self.coulomb_left[i] * abs(coulomb)
        return float(_OFF * own + of_load * abs(load))

    def doubted_at(self, i: int, doubt: float) -> float:
        """Uncertainty of the present friction of joint i at a doubt of 0 to 1 in learning [Nm]."""
        load = self._load_may_be[i] * abs(self.columns[i, _LOAD])
        return float(doubt * (_OFF * self.identified(i) + load))

    def stood(self, i: int) -> bool:
        """True for a joint that has stood so long that its gear cooled."""
        return bool(self.still_s[i] > _STANDS_S)

    def identified(self, i: int) -> float:
        """Size of the friction of joint i as it was identified, filtered as r is [Nm]."""
        return float(abs(self.columns[i, _VISCOUS]) + abs(self.columns[i, _COULOMB]))

    def unsettle(self, i: int) -> None:
        """Know friction no better than before anything was learned of it, and keep what is believed
        of it until it is learned anew."""
        for k in range(_VISCOUS, _COLUMNS):
            for m in range(_COLUMNS):
                self.covariance[i, k, m] = self.covariance[i, m, k] = 0.0
            self.covariance[i, k, k] = self._variance[k, i]
        self._say_what_is_left(i)

    def give_up(self, i: int) -> None:
        """Believe the friction that was identified."""
        self.shares[i, _VISCOUS] = self.shares[i, _COULOMB] = self.shares[i, _LOAD] = 0.0
        self.correction[i] = 0.0

    def step(
        self, i: int, coulomb: float, viscous: float, load: float, dt: float, pole: float,
        share: float,
    ) -> None:  # fmt: skip
        """Take the impulses [Nm s] of joint i over its interval of dt [s], filtered by `pole` and
        `share` of (13); impulses are 0 where they do not act on the link."""
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
        self, i: int, residual: float, level: float, usual: float, friction: float, raised: float,
        doubt: float, rubs: bool, moving: bool, suspended: bool, dt: float,
    ) -> None:  # fmt: skip
        """Learn of joint i, if nothing may be touching it: from the residual before its
        correction, the contact levels in force and configured, and what the one in force has of
        friction near rest, and of what fades [Nm]; doubt: in what was learned, 0 to 1; rubs:
        friction was seen to be another; moving: and rotor and link touch; suspended: nothing is
        learned, but a joint that stands cools."""
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
                i, corrected, level, usual, self.unknown[i], friction, raised,
                self._relearns(i, usual), moving, dt,
            )  # fmt: skip
        freezes = _THAWS if rubs else _FREEZES
        b = self.shares[i, _CONSTANT] * self.columns[i, _CONSTANT]
        surprise = abs(residual - self.correction[i] - b)
        calm = surprise <= freezes * level and size <= level  # NaN is not
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

    def _relearns(self, i: int, usual: float) -> bool:
        """True while friction of joint i is learned anew."""
        moved = abs(self.shares[i, _COULOMB] - self.settled[i]) * abs(self.columns[i, _COULOMB])
        return bool(moved > _RELEARNS * usual)

    def _rest(self, i: int, dt: float) -> None:
        """Know less of joint i after dt [s] in which its motion showed nothing."""
        self._drift(i, _VISCOUS, dt / _RESTING)
        self._drift(i, _COULOMB, dt / _RESTING)
        self._drift(i, _LOAD, dt / _RESTING)
        self._say_what_is_left(i)
        self.needed.rest(i, dt)

    def _drift(self, i: int, column: int, dt: float) -> None:
        """Know less of one share of joint i, after dt [s]: a process of Ornstein and Uhlenbeck."""
        fade = dt / self._forgets_s[column]
        self.shares[i, column] -= fade * self.shares[i, column]
        for k in range(_COLUMNS):
            self.covariance[i, column, k] -= fade * self.covariance[i, column, k]
            self.covariance[i, k, column] -= fade * self.covariance[i, k, column]
        self.covariance[i, column, column] += 2.0 * fade * self._variance[column, i]

    def _follow(self, i: int, residual: float, doubt: float, dt: float, known: bool) -> None:
        """Update all shares of joint i by a residual before its correction [Nm]; where it is not
        known that nothing touches, b alone (Schmidt's filter, which considers the others)."""
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
        """Standard deviation of a share, relative to the one before anything was learned."""
        left = self.covariance[i, column, column] / self._variance[column, i]
        return sqrt(min(max(left, 0.0), 1.0))

    def _forget(self, i: int) -> None:
        """Know no more of joint i than was identified."""
        for k in range(_COLUMNS):
            for m in range(_COLUMNS):
                self.covariance[i, k, m] = self._variance[k, i] if k == m else 0.0
            self.shares[i, k] = 0.0
        self.coulomb_left[i] = self.viscous_left[i] = 1.0
