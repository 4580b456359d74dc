# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Guide: leads the tool along some directions of a frame, and holds it in the others.

The velocity v = K r that eq. (15) heads for is projected onto what the held rows A of the frame's
Jacobian allow,

    v' = v - K A^T (A K A^T + C)^-1 A v        K = diag(K_a)

as if each held direction pushed back through the same admittance as the hand. The projection is
orthogonal in the metric K^-1, v'^T K^-1 v >= v'^T K^-1 v' >= 0: nothing is headed for against the
residual r, wherever on the arm the hand is. All of v is made as slow as the fastest joint may be:
bounded joint by joint it would be another direction. So the arm is led no more easily than without
a guide. Only then comes the virtual mass; what it leaves is projected, too.

C is a damper's compliance: almost none where a direction is held, _DAMPS times its mobility where
it is damped. A joint at the end of its room is one more row. A spring (`guide_spring`) takes the
tool back to where the guide began; and the way slows where the held rows are about to become
dependent.

Ordinary Python, which runs as it is; `guide.pxd` names types for the compiler.
"""

from math import sqrt

import numpy as np

from common.arrays import Matrix, Vector
from daemon.motion.back_rows import BackRows
from daemon.motion.guide_spring import ARM_M, DAMPED, FREE, HELD, STIFF, GuideSpring
from estimator.dynamics import Dynamics, Place
from estimator.frame import Frame
from estimator.model import Model

__all__ = ["DAMPED", "FREE", "HELD", "STIFF", "Guide"]

_DAMPS = 0.25  # compliance of a damped row, over its own mobility
_PASSES = 4  # joints that end their room make others turn further
_SPRING_M_S, _SPRING_RAD_S = 0.1, 0.3  # fastest way back of the tool and of a joint
# Least mobility of a row beside those before it, over their mean; time in which it is approached,
# and that over which it is foreseen [s].
_LEAST, _CREEPS, _NEARS_S, _FORESEEN_S = 2e-3, 1e-7, 0.3, 0.05
_LAGS_RAD_S = 0.15  # by which a drive is behind its setpoint as it speeds up
_NEAR = 1e-9
_ARM_M, _FREE, _DAMPED = ARM_M, FREE, DAMPED  # for the compiler
_ACROSS, _EVERY, _HOLDING = 0, 1, 2


class Guide:
    """Guide of one arm. `kinds` (6,) are those of x, y, z and the turns about them."""

    def __init__(
        self, model: Model, place: Place, velocity: Vector, rate: float, kinds: Vector,
        *, turned: bool = True, redundant: bool = True,
    ) -> None:  # fmt: skip
        """velocity: most of each joint (n,) [rad/s]; rate: of the spring [1/s]; turned: along the
        axes of `place` as they are when it begins, not those of the URDF's root; redundant: joints
        may move on where the frame stands."""
        n = self._n = model.n
        self._dynamics = Dynamics(model.bodies(), model.down)
        self._frame = Frame(self._dynamics, place)
        self._most = velocity.copy()
        self._turned, self._redundant = turned, redundant
        self.spring = GuideSpring(kinds, rate)
        self._q, self._rest, self._v, self._spring, self._moved, self._out = np.zeros((6, n))
        self._sent, self._presses, self._free = np.zeros((3, n))
        self._bound = np.zeros(n, dtype=np.int64)
        self._G, self._M = np.zeros((2, 3, 3))  # axes, in columns; orientation along them
        self._along = np.zeros((6, n))  # of the frame along the guide's axes, turns times _ARM_M
        self._rows = BackRows(6 + n, n)
        self.begun = False

    def forget(self) -> None:
        """Begin anew at the next `begin`, or where the frame is at the next step."""
        self.begun = False

    def begin(self, q: Vector) -> None:
        """Begin at q (n,) [rad], unless it has begun."""
        if not self.begun:
            known = 0.0
            for i in range(self._n):
                self._q[i] = q[i]
                known += q[i]
            if known - known == 0.0:
                self._see()

    def step(
        self, q: Vector, moved: Vector, sent: Vector, before: Vector, wanted: Vector,
        share: Vector, gain: Vector, room: Matrix, residual: Vector, hand: bool, dt: float,
        out: Vector,
    ) -> None:  # fmt: skip
        """Velocity (n,) [rad/s] into out, 0 in doubt, from q (n,) [rad], the velocities of the
        motors, 0 where not a number, and their last setpoints, the velocity before, the one that
        eq. (15) heads for, without bounds, and the share of the way to it, the gains, the largest
        velocities down and up (2, n) that are left, and the residual (n,) [Nm], in this tick of dt
        [s]; hand: something pushes."""
        known = 0.0
        for i in range(self._n):
            self._q[i] = q[i]
            self._v[i], out[i] = wanted[i], 0.0
            self._moved[i] = moved[i] if moved[i] - moved[i] == 0.0 else 0.0
            self._sent[i] = sent[i]
            self._bound[i] = 0
            self._presses[i] = 0.0
            self._spring[i] = gain[i] * residual[i]
            known += q[i] + wanted[i] + gain[i] + before[i] + share[i] + room[0, i] + room[1, i]
            known += residual[i]
        if known - known != 0.0:
            return
        self._see()
        self.spring.measure(self._frame.x, self._G, self._M, hand)
        self._resist(gain, dt)
        self._frame_alone(gain)
        rows = self._choose(_ACROSS)
        pivot = self._rows.factor(rows, gain)
        self._rows.ask(rows, self._v)
        self._rows.push(rows, gain, self._rows.ahead, self._out)
        for i in range(self._n):
            self._out[i] = self._v[i] - self._out[i]
        bounded = self._bounded()
        for i in range(self._n):
            self._v[i] = before[i] + share[i] * (bounded * self._out[i] - before[i])
            self._free[i] = before[i] + share[i] * (bounded * wanted[i] - before[i])
        self._frame_alone(gain)
        rows = self._choose(_HOLDING)
        self._rows.factor(rows, gain)
        for _ in range(_PASSES):
            self._rows.ask(rows, self._v)
            self._rows.push(rows, gain, self._rows.ahead, out)
            for i in range(self._n):
                out[i] = self._v[i] - out[i]
            more = self._limit(rows, room, out)
            if more == rows:
                break
            rows = more
            self._rows.factor(rows, gain)
        self._rows.push(rows, gain, self._rows.back, self._spring)
        gentle = self._gentle()
        slowed, whole = self._with_the_hand(gain, out) * self._slowed(pivot, gain, out), 1.0
        for i in range(self._n):
            out[i] = slowed * out[i] + gentle * self._spring[i] + self._presses[i]
            if whole * abs(out[i]) > self._most[i]:  # all alike, so that the guide is kept
                whole = self._most[i] / abs(out[i])
        for i in range(self._n):
            out[i] *= whole

    def _frame_alone(self, gain: Vector) -> None:
        """Take from `_v` what does not move the frame, where redundant joints are held."""
        if not self._redundant:
            self._rows.factor(self._choose(_EVERY), gain)
            self._rows.ask(6, self._v)
            self._rows.push(6, gain, self._rows.ahead, self._v)

    def _bounded(self) -> float:
        """Share of the velocity at which no joint is faster than it may be, neither as it is asked
        for, `_v`, nor as it is projected, `_out`."""
        share = 1.0
        for i in range(self._n):
            fastest = max(abs(self._v[i]), abs(self._out[i]))
            if share * fastest > self._most[i]:
                share = self._most[i] / fastest
        return share

    def _with_the_hand(self, gain: Vector, out: Vector) -> float:
        """Share of the velocity at which it is not against the one without a guide, `_free`, nor
        more than that has along it, in the metric K^-1: 1 for a projection, less where dampers and
        joints at their ends do not agree."""
        along = square = 0.0
        for i in range(self._n):
            if gain[i] > 0.0:
                along += out[i] * self._free[i] / gain[i]
                square += out[i] * out[i] / gain[i]
        return 1.0 if along >= square else max(along / square, 0.0)

    def _gentle(self) -> float:
        """Share of the spring's velocity at which joints and tool are no faster than it may be, and
        no drive is asked for much that a hand pushes back."""
        square, most, share = 0.0, _SPRING_RAD_S, 1.0
        for i in range(self._n):
            most = max(most, abs(self._spring[i]))
            if self._spring[i] * self._moved[i] < 0.0:
                share = min(share, max(1.0 - abs(self._moved[i]) / _SPRING_RAD_S, 0.0))
        for a in range(3):
            way = 0.0
            for i in range(self._n):
                way += self._along[a, i] * self._spring[i]
            square += way * way
        gentle = min(_SPRING_RAD_S / most, _SPRING_M_S / max(sqrt(square), _SPRING_M_S))
        return float(share * gentle)

    def _see(self) -> None:
        """Rows of the frame at the pose `_q`, along the guide's axes."""
        f, G, M = self._frame, self._G, self._M
        self._dynamics.at(self._q, self._rest)
        f.at()
        if not self.begun:
            for a in range(3):
                for b in range(3):
                    G[a, b] = f.R[a, b] if self._turned else float(a == b)
        for a in range(3):
            for b in range(3):
                M[a, b] = G[0, a] * f.R[0, b] + G[1, a] * f.R[1, b] + G[2, a] * f.R[2, b]
        if not self.begun:
            self.begun = True
            self.spring.begin(f.x, M)
        for i in range(self._n):
            for a in range(3):
                self._along[a, i] = self._along[3 + a, i] = 0.0
                for b in range(3):
                    self._along[a, i] += M[a, b] * f.J[b, i]
                    self._along[3 + a, i] += _ARM_M * M[a, b] * f.J[3 + b, i]

    def _resist(self, gain: Vector, dt: float) -> None:
        """Fade the spring by the force of the residual, K A^T force = `_spring`, along each of all
        axes, so that a force along a free one withstands nothing."""
        rows = self._choose(_EVERY)
        self._rows.factor(rows, gain)
        self._rows.ask(rows, self._spring)
        self._rows.push(rows, gain, self._rows.ahead, self._spring)
        for a in range(rows):
            self.spring.withstand(a, self._rows.y[a], dt)

    def _choose(self, which: int) -> int:
        """Rows A of the directions that are not free, of every one, or of those that are held;
        returns their number."""
        r, rows = self._rows, 0
        for a in range(6):
            damps = self.spring.kind[a] == _DAMPED
            if damps and which == _HOLDING:
                continue
            if which == _EVERY or self.spring.kind[a] != _FREE:
                for i in range(self._n):
                    r.A[rows, i] = self._along[a, i]
                r.c[rows] = _DAMPS if damps and which == _ACROSS else 0.0
                r.goal[rows], r.back[rows] = 0.0, self.spring.back[a]
                rows += 1
        return rows

    def _limit(self, rows: int, room: Matrix, out: Vector) -> int:
        """Add a row for each joint that would leave its room, or whose drive gives way: others then
        count on what it does, and it presses on a little. Returns the number of rows."""
        r = self._rows
        for i in range(self._n):
            if self._bound[i]:
                continue
            v = min(max(out[i], -room[0, i]), room[1, i])
            way = 1.0 if self._sent[i] > 0.0 else -1.0
            moves = max(way * self._moved[i], 0.0)
            if way * self._sent[i] > moves + _LAGS_RAD_S and way * v > moves:
                self._presses[i] = way * min(way * v - moves, _LAGS_RAD_S)
                v = way * moves
            if abs(out[i] - v) > _NEAR:
                for k in range(self._n):
                    r.A[rows, k] = 0.0
                r.A[rows, i], self._bound[i] = 1.0, 1
                r.c[rows], r.goal[rows], r.back[rows] = 0.0, v, 0.0
                rows += 1
        return rows

    def _slowed(self, pivot: float, gain: Vector, out: Vector) -> float:
        """Share of the velocity at which the held rows come no nearer to being dependent than they
        may. What leads away from there is as fast as ever."""
        for i in range(self._n):
            self._q[i] += _FORESEEN_S * out[i]
        self._see()
        falls = (pivot - self._rows.factor(self._choose(_ACROSS), gain)) / _FORESEEN_S
        left = max(pivot - _LEAST, _CREEPS)  # and on its end no jump between standing and leaving
        return float(left / (_NEARS_S * falls)) if falls * _NEARS_S > left else 1.0
