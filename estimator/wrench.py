# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Force at the tool, with its covariance, from the residuals of all joints and the doubt of each.

A force f at a point of the arm, along the axes of a frame there, is J^T f at the joints. A hand
does not press on it exactly: _OFF away, and the force has a moment m about the point, too.

    r = J^T f + L^T m + e,    e_i ~ N(0, s_i^2),    m ~ N(0, _OFF^2 |f|^2)

    f = S^-1 h,    covariance S^-1,    S = A - B (C + l 1)^-1 B^T,    h = g_f - B (C + l 1)^-1 g_m

A, B, C: blocks of the information of (f, m); l: that of m beforehand. s_i is made of what raises
the level of a joint: friction near rest, gap, friction not yet learned, load; and of what r has yet
to follow, the largest r' / K of late, as an arm swings under its push. A direction is seen where
its standard deviation is small; along the others nothing is claimed. The force is zero up to a
level of its own, in standard deviations, which quiet motion teaches as it teaches contact levels.

Nothing acts on it. Ordinary Python, which runs as it is; `wrench.pxd` names types for the compiler.
"""

from math import sqrt

import numpy as np

from estimator.dynamics import Dynamics, Place
from estimator.frame import Frame

FORCE, COVARIANCE, STRENGTH, MISFIT, UNSEEN, WIDTH = 0, 3, 9, 10, 11, 20
"""Columns of `shown`: force (3) [N], its covariance (xx xy xz yy yz zz) [N2], how often it exceeds
its level, misfit, and directions that are not seen (up to 3 by 3, then zeros)."""
SEEN_N, SEEN_SHARE, SEEN_MOST_N = 4.0, 0.25, 8.0
"""Largest standard deviation of a direction that is seen: [N], or of the force if that is more, up
to the last: a contact elsewhere looks like hundreds of newtons along what the joints hardly see."""

# Standard deviation of a residual: of its joint's contact level, friction near rest, raise,
# unlearned friction, transmitted torque, and of what the residual still lags behind; more of
# friction beyond a share of the level: pressed, such a joint stays stuck, and hides any of it.
# Chosen on 13 arms of `bench.wrench`, seeds 1 and 2, and for what sticks on Romeo's, 500 to 1700.
_LEVEL, _FRICTION, _RAISED, _UNLEARNED, _TORQUE, _LAG = 0.038, 0.15, 0.15, 1.3, 0.04, 0.85
_STUCK, _OF_LEVEL = 0.2, 0.5
_UNTAUGHT, _LEAST_NM = 0.3, 1e-3  # of the level, where nothing is learned; in any case
_OFF, _HIDDEN = 0.012, 2.0  # [m], along each axis; times what is seen
# Of a force beforehand [N]: of one whose size is sought, and of the one that is shown.
_USUAL_N, _ANY_N = 30.0, 1000.0
# The level; it is so many times the largest strength in quiet motion, which counts after _QUIET_S
# without a contact and _FADES_S for what is left of it, raises it by _GROWS, and fades in _PEAK_S.
_LEAST, _FIRST, _MOST, _OF_PEAK, _GROWS = 4.0, 5.5, 8.0, 1.4, 1.05
_QUIET_S, _FADES_S, _PEAK_S, _SWEEPS = 0.3, 1.0, 300.0, 8

# For the compiler.
_COVARIANCE, _STRENGTH, _MISFIT, _UNSEEN = COVARIANCE, STRENGTH, MISFIT, UNSEEN
_SEEN_N, _SEEN_SHARE, _SEEN_MOST_N = SEEN_N, SEEN_SHARE, SEEN_MOST_N


class Wrench:
    """Force at one point; `shown` (WIDTH,) is that of the last step."""

    def __init__(self, dynamics: Dynamics, tool: Place, gain: float, learns: bool) -> None:
        """gain: K of the residuals [1/s]; learns: friction is learned."""
        n = dynamics.n
        self._frame, self._gain = Frame(dynamics, tool), gain
        self._level = _LEVEL if learns else _UNTAUGHT
        # Residual at the tick before, and the largest r' / K of late [Nm].
        self.before, self.lag = np.zeros((2, n))
        self._r, self.weight = np.zeros((2, n))
        self._h, self._u = np.zeros((2, 3))
        self._N, self._S, self._V = np.zeros((3, 3, 3))
        self._Y, self._g = np.zeros((6, 6)), np.zeros(6)
        self.shown = np.zeros(WIDTH)
        # Largest strength in quiet motion; that which counts if it stays quiet; since when.
        self.peak, self.peak_seen, self.quiet_s = _FIRST / _OF_PEAK, 0.0, 0.0

    def weigh(
        self, i: int, r: float, dt: float, usual: float, friction: float, raised: float,
        unlearned: float, torque: float, senses: bool,
    ) -> None:  # fmt: skip
        """Take the residual of joint i [Nm], dt [s] after the one before: usual, its configured
        level by the share in force; friction, raised, unlearned: parts of the level in force;
        torque: transmitted. One that does not sense counts nothing."""
        lag = abs(r - self.before[i]) / (self._gain * dt)
        lag = self.lag[i] = max(lag, self.lag[i] / (1.0 + self._gain * dt))
        parts = (self._level * usual) * (self._level * usual) + _LEAST_NM * _LEAST_NM
        friction = _FRICTION * friction + _STUCK * max(friction - _OF_LEVEL * usual, 0.0)
        parts += friction * friction
        parts += (_RAISED * raised) * (_RAISED * raised)
        parts += (_UNLEARNED * unlearned) * (_UNLEARNED * unlearned)
        parts += (_TORQUE * torque) * (_TORQUE * torque) + (_LAG * lag) * (_LAG * lag)
        self._r[i] = r if senses else 0.0
        self.weight[i] = 1.0 / parts if senses else 0.0

    def step(self, dt: float, pressed: bool, teaches: bool) -> None:
        """Estimate from all joints, whose dynamics are those of now; learn the level in dt [s]
        where that teaches. pressed: a residual is beyond its contact level."""
        shown, S, V, h = self.shown, self._S, self._V, self._h
        self._frame.at()
        rr = self._inform()
        self._solve(0.0, _USUAL_N)
        square = self._size()
        self._solve(square, _USUAL_N)
        misfit = rr - self._solve(self._size(), _ANY_N)
        self._directions()
        strength = counted = 0.0
        for i in range(self.weight.shape[0]):
            counted += self.weight[i] > 0.0
        for k in range(3):
            along = V[0, k] * h[0] + V[1, k] * h[1] + V[2, k] * h[2]
            strength += along * along / S[k, k]
            self._u[k] = along / S[k, k]
        misfit -= strength
        strength = sqrt(max(strength, 0.0))
        level = self.level()
        self._show(strength > level)
        shown[_STRENGTH] = strength / level
        shown[_MISFIT] = sqrt(max(misfit, 0.0) / max(counted - 3.0, 1.0))
        if teaches:
            self._learn(strength, pressed or strength > level, dt)

    def level(self) -> float:
        """Level of the strength, in standard deviations."""
        return float(min(max(_OF_PEAK * self.peak, _LEAST), _MOST))

    def nothing(self) -> None:
        """Show that nothing is known."""
        shown = self.shown
        for k in range(len(shown)):
            shown[k] = 0.0
        for k in range(3):
            shown[_UNSEEN + 4 * k] = 1.0
        shown[_COVARIANCE] = shown[_COVARIANCE + 3] = shown[_COVARIANCE + 5] = _ANY_N * _ANY_N
        self.quiet_s = self.peak_seen = 0.0

    def _learn(self, strength: float, touched: bool, dt: float) -> None:
        """Note the strength in quiet motion: a contact begins below the level, too."""
        self.peak -= dt / _PEAK_S * self.peak
        if touched:
            self.quiet_s, self.peak_seen = -_FADES_S, 0.0
            return
        self.quiet_s += dt
        if self.quiet_s >= 0.0 and strength > self.peak_seen:
            self.peak_seen, self.quiet_s = strength, 0.0
        if self.quiet_s > _QUIET_S:
            self.peak = max(self.peak, min(self.peak_seen, _GROWS * self.peak))
            self.quiet_s = self.peak_seen = 0.0

    def _inform(self) -> float:
        """Information of force and moment, and its vector; returns the weighted square of r."""
        J, Y, g, rr = self._frame.J, self._Y, self._g, 0.0
        for a in range(6):
            g[a] = 0.0
            for b in range(a + 1):
                Y[a, b] = 0.0
        for i in range(self.weight.shape[0]):
            w, r = self.weight[i], self._r[i]
            rr += w * r * r
            for a in range(6):
                wJ = w * J[a, i]
                g[a] += wJ * r
                for b in range(a + 1):
                    Y[a, b] += wJ * J[b, i]
        return rr

    def _solve(self, square: float, any_N: float) -> float:
        """S and h with a force of this square [N2] in the moment; f = S^-1 h. Returns what the
        moment explains of the square of r."""
        Y, g, N, S, h = self._Y, self._g, self._N, self._S, self._h
        beforehand = 1.0 / (_OFF * _OFF * square + 1e-6)
        for a in range(3):
            for b in range(3):
                N[a, b] = Y[3 + max(a, b), 3 + min(a, b)]
            N[a, a] += beforehand
        self._invert()
        explained = 0.0
        for a in range(3):
            h[a] = g[a]
            for b in range(3):
                explained += g[3 + a] * N[a, b] * g[3 + b]
                S[a, b] = Y[max(a, b), min(a, b)]
            S[a, a] += 1.0 / (any_N * any_N)
        for a in range(3):
            for c in range(3):
                through = 0.0
                for b in range(3):
                    through += Y[3 + b, a] * N[b, c]
                h[a] -= through * g[3 + c]
                for b in range(3):
                    S[a, b] -= through * Y[3 + c, b]
        return explained

    def _size(self) -> float:
        """Square of the force S^-1 h, and of what may press along directions that are not seen: up
        to _HIDDEN times that [N2]."""
        N, S, h, square, hidden = self._N, self._S, self._h, 0.0, 0.0
        for a in range(3):
            for b in range(3):
                N[a, b] = S[a, b]
        self._invert()
        for a in range(3):
            along = N[a, 0] * h[0] + N[a, 1] * h[1] + N[a, 2] * h[2]
            square += along * along
            hidden += N[a, a]
        return square + min(hidden, _HIDDEN * square)

    def _invert(self) -> None:
        """N becomes its inverse; it is symmetric and positive."""
        N = self._N
        a, b, c, d, e, f = N[0, 0], N[0, 1], N[0, 2], N[1, 1], N[1, 2], N[2, 2]
        A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
        D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
        one = 1.0 / (a * A + b * B + c * C)
        N[0, 0], N[1, 1], N[2, 2] = A * one, D * one, F * one
        N[0, 1] = N[1, 0] = B * one
        N[0, 2] = N[2, 0] = C * one
        N[1, 2] = N[2, 1] = E * one

    def _directions(self) -> None:
        """S becomes diagonal, V its directions in columns: Jacobi's rotations."""
        S, V = self._S, self._V
        for a in range(3):
            for b in range(3):
                V[a, b] = 1.0 if a == b else 0.0
        for _ in range(_SWEEPS):
            off = abs(S[0, 1]) + abs(S[0, 2]) + abs(S[1, 2])
            if off <= 1e-14 * (S[0, 0] + S[1, 1] + S[2, 2]):
                break
            for p in range(2):
                for q in range(p + 1, 3):
                    self._rotate(p, q)
        for a in range(3):
            S[a, a] = max(S[a, a], 1.0 / (_ANY_N * _ANY_N))

    def _rotate(self, p: int, q: int) -> None:
        """Turn the plane of p and q so that S[p, q] vanishes."""
        S, V, o = self._S, self._V, 3 - p - q
        if S[p, q] == 0.0:
            return
        theta = 0.5 * (S[q, q] - S[p, p]) / S[p, q]
        t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + sqrt(theta * theta + 1.0))
        c = 1.0 / sqrt(t * t + 1.0)
        s = t * c
        S[p, p] -= t * S[p, q]
        S[q, q] += t * S[p, q]
        S[p, q] = S[q, p] = 0.0
        op, oq = S[o, p], S[o, q]
        S[o, p] = S[p, o] = c * op - s * oq
        S[o, q] = S[q, o] = s * op + c * oq
        for a in range(3):
            vp, vq = V[a, p], V[a, q]
            V[a, p], V[a, q] = c * vp - s * vq, s * vp + c * vq

    def _show(self, acts: bool) -> None:
        """Force along the directions that are seen, if it acts, covariance, and the others."""
        shown, S, V, square = self.shown, self._S, self._V, 0.0
        for k in range(len(shown)):
            shown[k] = 0.0
        slot = _UNSEEN
        for k in range(3):
            if S[k, k] * _SEEN_MOST_N * _SEEN_MOST_N >= 1.0:
                square += self._u[k] * self._u[k]
        most = min(_SEEN_SHARE * _SEEN_SHARE * square, _SEEN_MOST_N * _SEEN_MOST_N)
        most = max(_SEEN_N * _SEEN_N, most if acts else 0.0)
        for k in range(3):
            variance = 1.0 / S[k, k]
            seen = variance <= most
            column = _COVARIANCE
            for a in range(3):
                shown[a] += self._u[k] * V[a, k] if acts and seen else 0.0
                if not seen:
                    shown[slot] = V[a, k]
                    slot += 1
                for b in range(a, 3):
                    shown[column] += variance * V[a, k] * V[b, k]
                    column += 1
