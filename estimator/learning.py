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

What is not known yet raises the levels: `unknown` is the torque that friction, wrong by _OFF, would
make there, less by what the joint has shown since.

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
_SPREAD, _NOISE = (0.5, 0.03, 0.4, 0.4), 0.1
# Largest share of each; that of b is of no use.
_BOUND = (0.0, 0.06, 0.6, 0.6)
# Share by which friction that was identified may be off before anything is learned, and that which
# remains however much was: it depends on load and pose.
_OFF, _REMAINS = 0.5, 0.15
# Nothing is learned for _FROZEN_S after the residual was beyond this share of the level in force.
_FREEZES, _FROZEN_S = 0.5, 0.3
_MOVING = 0.05  # [rad/s]


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
        self.quiet_s, self.correction, self.unknown = np.zeros((3, n))
        self._L = np.zeros((_COLUMNS, _COLUMNS))
        self._D, self._x = np.zeros((2, _COLUMNS))
        for i in range(n):
            self._forget(i)

    def reset(self, i: int) -> None:
        """Begin with r = 0 anew; what was learned of joint i stays."""
        for k in range(_COLUMNS):
            self.columns[i, k] = 0.0
        self.correction[i] = self.unknown[i] = self.quiet_s[i] = 0.0

    def friction(self, i: int) -> float:
        """Friction of joint i over what was identified."""
        return 1.0 - float(self.shares[i, _COULOMB])

    def error(self, i: int) -> float:
        """Share by which the friction of joint i may still be off."""
        return _REMAINS + _OFF * float(self.coulomb_left[i])

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
        self.unknown[i] = _OFF * (
            self.viscous_left[i] * abs(c[i, _VISCOUS]) + self.coulomb_left[i] * abs(c[i, _COULOMB])
        )

    def learn(
        self, i: int, residual: float, level: float, theta_dot: float, touched: bool, dt: float
    ) -> None:
        """Learn from joint i, unless something may be touching it: from the residual before its
        correction [Nm], the level in force [Nm] and the motor velocity [rad/s]; touched: rotor and
        link touch."""
        if not abs(residual - self.correction[i]) <= _FREEZES * level:  # NaN is not quiet
            self.quiet_s[i] = 0.0
            return
        self.quiet_s[i] += dt
        if self.quiet_s[i] <= _FROZEN_S or abs(theta_dot) <= _MOVING or not touched:
            return
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
