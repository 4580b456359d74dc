# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Force at the tool, with its covariance, from the residuals of all joints and their uncertainties.

A force f at a point of the arm, along the axes of a frame there, causes joint torques J^T f. A hand
does not press exactly there but _OFF away, so the force has a moment m about the point, too.

    r = J^T f + L^T m + e,    e_i ~ N(0, s_i^2),    m ~ N(0, _OFF^2 |f|^2)

    f = S^-1 h,    covariance S^-1,    S = A - B (C + l 1)^-1 B^T,    h = g_f - B (C + l 1)^-1 g_m

A, B, C: blocks of the information of (f, m); l: prior information of m. s_i combines what raises
the level of a joint (friction near rest, gap, friction not yet learned, load) with what r has yet
to follow, the largest recent r' / K, as an arm swings under a push. A direction is seen if its
standard deviation is small; along the others nothing is claimed. The force is zero up to a level of
its own, in standard deviations, which is learned in quiet motion, like contact levels.

No reaction of the arm depends on it.
"""

from math import sqrt

import numpy as np

from estimator.dynamics import Dynamics, Place
from estimator.frame import Frame

FORCE, COVARIANCE, STRENGTH, MISFIT, UNSEEN, WIDTH = 0, 3, 9, 10, 11, 20
"""Columns of `shown`: force (3) [N], its covariance (xx xy xz yy yz zz) [N2], ratio of its strength
to its level, misfit, and unseen directions (up to 3 by 3, then zeros)."""
SEEN_N, SEEN_SHARE, SEEN_MOST_N = 4.0, 0.25, 8.0
"""Largest standard deviation of a direction that is seen: [N], or a share of the force if that is
more, at most [N]: a contact elsewhere looks like hundreds of newtons along unseen directions."""

# Standard deviation of a residual, in shares of its joint's contact level, friction near rest,
# raise, unlearned friction, transmitted torque and remaining lag; and more of friction beyond the
# share _OF_LEVEL of the level: pressed, such a joint sticks, and hides any of it. Chosen on 13 arms
# of `bench.wrench`, seeds 1 and 2, and for sticking joints on Romeo, seeds 500 to 1700.
_LEVEL, _FRICTION, _RAISED, _UNLEARNED, _TORQUE, _LAG = 0.038, 0.15, 0.15, 1.3, 0.04, 0.85
_STUCK, _OF_LEVEL = 0.2, 0.5
_UNTAUGHT, _LEAST_NM = 0.3, 1e-3  # share of the level without learning; lower bound
_OFF, _HIDDEN = 0.012, 2.0  # [m], along each axis; factor on the seen force
# Prior standard deviation of the force [N]: while its size is sought, and in the result.
_USUAL_N, _ANY_N = 30.0, 1000.0
# Level: _OF_PEAK times the largest strength in quiet motion, within bounds. A strength counts after
# _QUIET_S without a contact, plus _FADES_S for the decay of one; it raises the peak by _GROWS at
# most, and fades in _PEAK_S.
_LEAST, _FIRST, _MOST, _OF_PEAK, _GROWS = 4.0, 5.5, 8.0, 1.4, 1.05
_QUIET_S, _FADES_S, _PEAK_S, _SWEEPS = 0.3, 1.0, 300.0, 8

# For the compiler.
_COVARIANCE, _STRENGTH, _MISFIT, _UNSEEN = COVARIANCE, STRENGTH, MISFIT, UNSEEN
_SEEN_N, _SEEN_SHARE, _SEEN_MOST_N = SEEN_N, SEEN_SHARE, SEEN_MOST_N


class Wrench:
    """Force at one point; `shown` (WIDTH,) is the result of the last step."""

    def __init__(self, dynamics: Dynamics, tool: Place, gain: float, learns: bool) -> None:
        """gain: K of the residuals [1/s]; learns: whether friction is learned."""
        n = dynamics.n
        self._frame, self._gain = Frame(dynamics, tool), gain
        self._level = _LEVEL if learns else _UNTAUGHT
        # Residual at the previous tick, and largest recent r' / K [Nm].
        self.before, self.lag = np.zeros((2, n))
        self._r, self.weight = np.zeros((2, n))
        self._h, self._u = np.zeros((2, 3))
        self._N, self._S, self._V = np.zeros((3, 3, 3))
        self._Y, self._g = np.zeros((6, 6)), np.zeros(6)
        self.shown = np.zeros(WIDTH)
        # Largest strength in quiet motion; one that counts if it stays quiet; time of quiet [s].
        self.peak, self.peak_seen, self.quiet_s = _FIRST / _OF_PEAK, 0.0, 0.0

    def weigh(
        self, i: int, r: float, dt: float, configured: float, friction: float, raised: float,
        unlearned: float, torque: float, senses: bool,
    ) -> None:  # fmt: skip
        """Take the residual of joint i [Nm], dt [s] after the previous one. configured: its level
        times the share in force; friction, raised, unlearned: parts of the level in force;
        torque: transmitted. A joint that does not sense has no weight."""
        lag = abs(r - self.before[i]) / (self._gain * dt)
        lag = self.lag[i] = max(lag, self.lag[i] / (1.0 + self._gain * dt))
        parts = (self._level * configured) * (self._level * configured) + _LEAST_NM * _LEAST_NM
        friction = _FRICTION * friction + _STUCK * max(friction - _OF_LEVEL * configured, 0.0)
        parts += friction * friction
        parts += (_RAISED * raised) * (_RAISED * raised)
        parts += (_UNLEARNED * unlearned) * (_UNLEARNED * unlearned)
        parts += (_TORQUE * torque) * (_TORQUE * torque) + (_LAG * lag) * (_LAG * lag)
        self._r[i] = r if senses else 0.0
        self.weight[i] = 1.0 / parts if senses else 0.0

    def step(self, dt: float, pressed: bool, teaches: bool) -> None:
        """Estimate the force from all joints, at the pose of the dynamics; learn the level over dt
        [s] if that `teaches`. pressed: a residual exceeds its contact level."""
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
        """Output zero force, with every direction unseen."""
        shown = self.shown
        for k in range(len(shown)):
            shown[k] = 0.0
        for k in range(3):
            shown[_UNSEEN + 4 * k] = 1.0
        shown[_COVARIANCE] = shown[_COVARIANCE + 3] = shown[_COVARIANCE + 5] = _ANY_N * _ANY_N
        self.quiet_s = self.peak_seen = 0.0

    def _learn(self, strength: float, touched: bool, dt: float) -> None:
        """Track the strength in quiet motion; a contact, too, begins below the level."""
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
        """Compute the information matrix and vector of (f, m); returns the weighted square of r."""
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
        """Compute S and h, such that f = S^-1 h, with the moment of a force of this square [N2];
        any_N: prior of the force [N]. Returns the part of r's square that the moment explains."""
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
        """Square of the force S^-1 h, plus that of what may press along unseen directions, up to
        _HIDDEN times as much [N2]."""
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
        """Invert N, which is symmetric and positive definite, in place."""
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
        """Diagonalise S by Jacobi rotations; the columns of V become its directions."""
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
        """Rotate the plane of p and q so that S[p, q] vanishes."""
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
        """Write the force along seen directions if it `acts`, the covariance, and unseen
        directions."""
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
