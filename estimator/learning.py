# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Learning of friction and gain while the arm works: small corrections of what was identified.

What a residual shows while nothing touches is in good part friction and gain that are off:

    r = w1 c + w2 v - w3 m + b + noise      c, v, m: Coulomb friction, viscous friction and motor
                                            torque of the model, each filtered as r is by (13)

The shares w are found by least squares that forget in a minute, and w1 c + w2 v - w3 m is taken off
the residual. b is found beside them and never taken off: a hand that leans on the arm is constant,
while friction turns with the motion. Nothing is learned while something may be touching, at rest,
or inside a gap; no share goes beyond its bound.

What is not known yet raises the levels: `unknown` is the torque that friction, wrong by _OFF,
would make there, less by what the joint has shown since. What is known sinks them: `level(i)` is
the share of the configured level that the corrected residual has needed in the last minutes of
motion; never more than all of it.

Ordinary Python, which runs as it is; `learning.pxd` names the types for the compiler.
"""

from math import sqrt

import numpy as np

from arrays import Vector

# Columns of the fit; what is asked about comes last, where the factors tell its variance.
_CONSTANT, _MOTOR, _VISCOUS, _COULOMB, _COLUMNS = 0, 1, 2, 3, 4
_FORGETS_S = 60.0
# As long as these [s] of motion must last to weigh as much as what was identified.
_TRUSTED_S = 2.0
# Standard deviation of each share, that of b of the contact level; and of what is no friction.
_SPREAD, _NOISE = (1.0, 0.015, 0.4, 0.4), 0.1
# Largest share of each; that of b is of no use.
_BOUND = (0.0, 0.06, 0.7, 0.7)
# Share by which friction that was identified may be off before anything is learned, and that which
# remains however much was: it depends on load and pose.
_OFF, _REMAINS = 0.5, 0.15
# Nothing is learned for _FROZEN_S after the residual was beyond this share of the level in force.
_FREEZES, _FROZEN_S = 0.5, 0.3

# Of the level is needed what was _OF_RMS root mean squares, over _RMS_S of motion that began with
# _AT_FIRST_S at which all of it was; and _OF_PEAK peaks, which fade in _PEAK_S. What is loud,
# beyond the freeze, for longer than _LASTS_S may be a person, and does not count.
_OF_RMS, _RMS_S, _AT_FIRST_S = 2.7, 300.0, 10.0
_OF_PEAK, _PEAK_S, _LASTS_S = 1.4, 600.0, 1.0
# While a gap is crossed, and the raise for it lasts, _OF_CROSSING peaks count apart: they fade in
# so many seconds of that, from 1 on. It lasts as long as it is more than that share of the level.
_OF_CROSSING, _CROSSING_S, _CROSSING = 1.8, 20.0, 0.05
_LEAST_LEVEL = 0.2
# Before it is quiet again a peak raises the level by no more than this.
_AHEAD = 1.35


class Learning:
    """Shares of an arm's joints; `correction` and `unknown` (n,) [Nm]."""

    def __init__(self, contact: Vector, period_s: float) -> None:
        """contact: levels (n,) [Nm]."""
        n = len(contact)
        self._forgets = 1.0 / _FORGETS_S
        spread = np.repeat(_SPREAD, n).reshape(_COLUMNS, n)
        spread[_CONSTANT] *= contact
        self._prior = (_NOISE * contact / spread) ** 2 * (_TRUSTED_S / period_s)  # (columns, n)
        self._bound = np.array(_BOUND)
        # Information matrix and vector of each joint, and columns of now, filtered.
        self.information = np.zeros((n, _COLUMNS, _COLUMNS))
        self.evidence, self.columns, self.shares = np.zeros((3, n, _COLUMNS))
        # Of the standard deviation of both kinds of friction before anything was learned.
        self.coulomb_left, self.viscous_left = np.ones((2, n))
        self.quiet_s, self.loud_s, self.correction, self.unknown = np.zeros((4, n))
        # Of the corrected residual in motion, over the configured level: its square, and the time
        # over which that was integrated; and what of it no raise explained, at most.
        self.squares_s, self.moved_s = np.full(n, _AT_FIRST_S / _OF_RMS**2), np.full(n, _AT_FIRST_S)
        self.peak, self.crossing_peak = np.zeros(n), np.ones(n)
        # Those that count when it was quiet after them: a contact begins below the level, too.
        self.peak_seen, self.crossing_seen = np.zeros((2, n))
        self._L = np.zeros((_COLUMNS, _COLUMNS))
        self._D, self._x = np.zeros((2, _COLUMNS))
        for i in range(n):
            self._forget(i)

    def reset(self, i: int) -> None:
        """Begin with r = 0 anew; what was learned of joint i stays."""
        for k in range(_COLUMNS):
            self.columns[i, k] = 0.0
        self.correction[i] = self.unknown[i] = self.quiet_s[i] = self.loud_s[i] = 0.0
        self.peak_seen[i] = self.crossing_seen[i] = 0.0

    def level(self, i: int) -> float:
        """Share of the configured level that joint i needs in motion."""
        share = _OF_RMS * sqrt(self.squares_s[i] / self.moved_s[i])
        share = max(share, _OF_PEAK * self.peak[i], _LEAST_LEVEL)
        ahead = min(_OF_PEAK * self.peak_seen[i], _AHEAD * share)
        return float(min(max(share, ahead), 1.0))

    def crossing_level(self, i: int) -> float:
        """Share of the configured level that joint i needs while it crosses its gap."""
        return float(min(_OF_CROSSING * self.crossing_peak[i], 1.0))

    def friction(self, i: int) -> float:
        """Friction of joint i over what was identified."""
        return 1.0 - float(self.shares[i, _COULOMB])

    def error(self, i: int) -> float:
        """Share by which the friction of joint i may still be off."""
        return _REMAINS + _OFF * float(self.coulomb_left[i])

    def unknown_at(self, i: int, coulomb: float, viscous: float) -> float:
        """What is unknown of such friction of joint i [Nm]."""
        return float(
            _OFF * (self.viscous_left[i] * abs(viscous) + self.coulomb_left[i] * abs(coulomb))
        )

    def step(
        self, i: int, coulomb: float, viscous: float, motor: float, dt: float, pole: float,
        share: float,
    ) -> None:  # fmt: skip
        """Take the impulses [Nm s] of joint i over its interval of dt [s], filtered by `pole` and
        `share` of (13); impulses are 0 where they do not act on the link."""
        c, w = self.columns, self.shares
        c[i, _CONSTANT] = pole * c[i, _CONSTANT] + share * dt
        c[i, _MOTOR] = pole * c[i, _MOTOR] - share * motor
        c[i, _VISCOUS] = pole * c[i, _VISCOUS] + share * viscous
        c[i, _COULOMB] = pole * c[i, _COULOMB] + share * coulomb
        self.correction[i] = (
            w[i, _MOTOR] * c[i, _MOTOR]
            + w[i, _VISCOUS] * c[i, _VISCOUS]
            + w[i, _COULOMB] * c[i, _COULOMB]
        )
        self.unknown[i] = self.unknown_at(i, c[i, _COULOMB], c[i, _VISCOUS])

    def learn(
        self, i: int, residual: float, level: float, usual: float, friction: float, raised: float,
        moving: bool, dt: float,
    ) -> None:  # fmt: skip
        """Learn from joint i, unless something may be touching it: from the residual before its
        correction, the contact levels in force and configured, and what the one in force has of
        friction near rest, and of what fades [Nm]; moving: and rotor and link touch."""
        size = abs(residual - self.correction[i])
        quiet = size <= _FREEZES * level  # NaN is not
        self.quiet_s[i] = self.quiet_s[i] + dt if quiet else 0.0
        self.loud_s[i] = 0.0 if quiet else self.loud_s[i] + dt
        if not size <= level or self.loud_s[i] > _LASTS_S:
            self.peak_seen[i] = self.crossing_seen[i] = 0.0
        elif moving:
            needed = (size - friction) / (usual + self.unknown[i])
            if raised > _CROSSING * usual:
                self.crossing_peak[i] -= dt / _CROSSING_S * self.crossing_peak[i]
                self.crossing_seen[i] = max(self.crossing_seen[i], needed)
            else:
                self._measure(i, size / usual, needed, dt)
        if self.quiet_s[i] > _FROZEN_S:
            self.peak[i] = max(self.peak[i], self.peak_seen[i])
            self.crossing_peak[i] = max(self.crossing_peak[i], self.crossing_seen[i])
            self.peak_seen[i] = self.crossing_seen[i] = 0.0
            if moving:
                self._fit(i, residual, dt)

    def _measure(self, i: int, size: float, needed: float, dt: float) -> None:
        """Put the size of a residual, and what it needed, both over the configured level, to those
        before."""
        fade = dt / _RMS_S
        self.squares_s[i] += dt * size * size - fade * self.squares_s[i]
        self.moved_s[i] += dt - fade * self.moved_s[i]
        self.peak[i] -= dt / _PEAK_S * self.peak[i]
        self.peak_seen[i] = max(self.peak_seen[i], needed)

    def _fit(self, i: int, residual: float, dt: float) -> None:
        """Put a residual before its correction [Nm] to those before, and solve for the shares."""
        fade = dt * self._forgets
        for k in range(_COLUMNS):
            for m in range(k + 1):
                self.information[i, k, m] += (
                    self.columns[i, k] * self.columns[i, m] - fade * self.information[i, k, m]
                )
            self.information[i, k, k] += fade * self._prior[k, i]
            self.evidence[i, k] += self.columns[i, k] * residual - fade * self.evidence[i, k]
        if not self._solve(i):
            self._forget(i)

    def _forget(self, i: int) -> None:
        """Know no more of joint i than was identified."""
        for k in range(_COLUMNS):
            for m in range(_COLUMNS):
                self.information[i, k, m] = self._prior[k, i] if k == m else 0.0
            self.evidence[i, k] = self.shares[i, k] = 0.0
        self.coulomb_left[i] = self.viscous_left[i] = 1.0

    def _solve(self, i: int) -> bool:
        """Shares, and what is left of their deviations, by L D L' w = evidence, of whose left side
        the lower half is kept. False if it is no longer positive definite, or finite."""
        L, D, x = self._L, self._D, self._x
        for k in range(_COLUMNS):
            x[k] = self.evidence[i, k]
            D[k] = self.information[i, k, k]
            for m in range(k):
                value = self.information[i, k, m]
                for j in range(m):
                    value -= L[k, j] * L[m, j] * D[j]
                L[k, m] = value / D[m]
                D[k] -= L[k, m] * value
                x[k] -= L[k, m] * x[m]
            if not 0.0 < D[k] < 1e300:
                return False
        for k in range(_COLUMNS - 1, -1, -1):
            x[k] /= D[k]
            for m in range(k + 1, _COLUMNS):
                x[k] -= L[m, k] * x[m]
            self.shares[i, k] = min(max(x[k], -self._bound[k]), self._bound[k])
        # The last of the inverse, and the one before it, are sums of few factors.
        coulomb = self._prior[_COULOMB, i] / D[_COULOMB]
        lever = L[_COULOMB, _VISCOUS]
        viscous = self._prior[_VISCOUS, i] * (1.0 / D[_VISCOUS] + lever * lever / D[_COULOMB])
        self.coulomb_left[i] = sqrt(min(coulomb, 1.0))
        self.viscous_left[i] = sqrt(min(viscous, 1.0))
        return True
