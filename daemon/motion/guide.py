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

C is a damper's compliance: almost none where a direction is held, _DAMPING times its mobility where
it is damped. A joint at its limit is one more row. A spring (`guide_spring`) takes the tool back to
where the guide began. Near a singularity of the held rows the motion becomes slow.

Ordinary Python, which runs as it is; `guide.pxd` names types for the compiler.
"""

from math import sqrt

import numpy as np

from common.arrays import Matrix, Vector
from daemon.motion.constraint_rows import ConstraintRows
from daemon.motion.guide_spring import ARM_M, DAMPED, FREE, HELD, STIFF, GuideSpring
from estimator.dynamics import Dynamics, Place
from estimator.frame import Frame
from estimator.model import Model

__all__ = ["DAMPED", "FREE", "HELD", "STIFF", "Guide"]

_DAMPING = 0.25  # compliance of a damped row, over its own mobility
_PASSES = 4  # a joint at its limit makes others turn further
_SPRING_M_S, _SPRING_RAD_S = 0.1, 0.3  # fastest way back of the tool and of a joint
# Least mobility of a row beside those before it, over their mean; time constant of the approach to
# it, and time ahead at which it is predicted [s].
_LEAST_PIVOT, _LEAST_LEFT, _APPROACH_S, _LOOKAHEAD_S = 2e-3, 1e-7, 0.3, 0.05
_DRIVE_LAG_RAD_S = 0.15  # of the velocity behind its setpoint, as it rises
_TOLERANCE = 1e-9
_ARM_M, _FREE, _DAMPED = ARM_M, FREE, DAMPED  # for the compiler
_NOT_FREE, _ALL, _HELD_ROWS = 0, 1, 2


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
        self._max_velocity = velocity.copy()
        self._turned, self._redundant = turned, redundant
        self.spring = GuideSpring(kinds, rate)
        self._q, self._rest, self._v, self._spring, self._out = np.zeros((5, n))
        self._motor_velocity, self._setpoint, self._press, self._unguided = np.zeros((4, n))
        self._bound = np.zeros(n, dtype=np.int64)
        self._G, self._M = np.zeros((2, 3, 3))  # axes, in columns; orientation along them
        self._along = np.zeros((6, n))  # of the frame along the guide's axes, turns times _ARM_M
        self._rows = ConstraintRows(6 + n, n)
        self.started = False

    def forget(self) -> None:
        """Begin anew at the next `begin`, or where the frame is at the next step."""
        self.started = False

    def begin(self, q: Vector) -> None:
        """Begin at q (n,) [rad], unless it has started."""
        if not self.started:
            known = 0.0
            for i in range(self._n):
                self._q[i] = q[i]
                known += q[i]
            if known - known == 0.0:
                self._update_rows()

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
            self._motor_velocity[i] = moved[i] if moved[i] - moved[i] == 0.0 else 0.0
            self._setpoint[i] = sent[i]
            self._bound[i] = 0
            self._press[i] = 0.0
            self._spring[i] = gain[i] * residual[i]
            known += q[i] + wanted[i] + gain[i] + before[i] + share[i] + room[0, i] + room[1, i]
            known += residual[i]
        if known - known != 0.0:
            return
        self._update_rows()
        self.spring.measure(self._frame.x, self._G, self._M, hand)
        self._fade_spring(gain, dt)
        self._remove_null_space(gain)
        rows = self._select_rows(_NOT_FREE)
        pivot = self._rows.factor(rows, gain)
        self._rows.measure_excess(rows, self._v)
        self._rows.correction(rows, gain, self._rows.excess, self._out)
        for i in range(self._n):
            self._out[i] = self._v[i] - self._out[i]
        speed_share = self._speed_share()
        for i in range(self._n):
            self._v[i] = before[i] + share[i] * (speed_share * self._out[i] - before[i])
            self._unguided[i] = before[i] + share[i] * (speed_share * wanted[i] - before[i])
        self._remove_null_space(gain)
        rows = self._select_rows(_HELD_ROWS)
        self._rows.factor(rows, gain)
        for _ in range(_PASSES):
            self._rows.measure_excess(rows, self._v)
            self._rows.correction(rows, gain, self._rows.excess, out)
            for i in range(self._n):
                out[i] = self._v[i] - out[i]
            more = self._add_joint_limits(rows, room, out)
            if more == rows:
                break
            rows = more
            self._rows.factor(rows, gain)
        self._rows.correction(rows, gain, self._rows.spring, self._spring)
        spring_share = self._spring_share()
        led_share = self._passive_share(gain, out) * self._singularity_share(pivot, gain, out)
        whole = 1.0
        for i in range(self._n):
            out[i] = led_share * out[i] + spring_share * self._spring[i] + self._press[i]
            if whole * abs(out[i]) > self._max_velocity[i]:  # all alike, so that the guide is kept
                whole = self._max_velocity[i] / abs(out[i])
        for i in range(self._n):
            out[i] *= whole

    def _remove_null_space(self, gain: Vector) -> None:
        """Remove from `_v` the motion in the frame's null space, if redundant joints are held."""
        if not self._redundant:
            self._rows.factor(self._select_rows(_ALL), gain)
            self._rows.measure_excess(6, self._v)
            self._rows.correction(6, gain, self._rows.excess, self._v)

    def _speed_share(self) -> float:
        """Share of the velocity that keeps the bounds of all joints, as commanded, `_v`, and as
        projected, `_out`."""
        share = 1.0
        for i in range(self._n):
            fastest = max(abs(self._v[i]), abs(self._out[i]))
            if share * fastest > self._max_velocity[i]:
                share = self._max_velocity[i] / fastest
        return share

    def _passive_share(self, gain: Vector, out: Vector) -> float:
        """Share of the velocity at which it is not against the one without a guide, `_unguided`,
        nor more than that has along it, in the metric K^-1: 1 for a projection, less where dampers
        and joints at their ends do not agree."""
        along = square = 0.0
        for i in range(self._n):
            if gain[i] > 0.0:
                along += out[i] * self._unguided[i] / gain[i]
                square += out[i] * out[i] / gain[i]
        return 1.0 if along >= square else max(along / square, 0.0)

    def _spring_share(self) -> float:
        """Share of the spring's velocity that keeps the bounds of joints and tool, and is less
        where a hand pushes a drive back."""
        square, most, share = 0.0, _SPRING_RAD_S, 1.0
        for i in range(self._n):
            most = max(most, abs(self._spring[i]))
            if self._spring[i] * self._motor_velocity[i] < 0.0:
                share = min(share, max(1.0 - abs(self._motor_velocity[i]) / _SPRING_RAD_S, 0.0))
        for a in range(3):
            way = 0.0
            for i in range(self._n):
                way += self._along[a, i] * self._spring[i]
            square += way * way
        spring_share = min(_SPRING_RAD_S / most, _SPRING_M_S / max(sqrt(square), _SPRING_M_S))
        return float(share * spring_share)

    def _update_rows(self) -> None:
        """Rows of the frame at the pose `_q`, along the guide's axes."""
        f, G, M = self._frame, self._G, self._M
        self._dynamics.at(self._q, self._rest)
        f.at()
        if not self.started:
            for a in range(3):
                for b in range(3):
                    G[a, b] = f.R[a, b] if self._turned else float(a == b)
        for a in range(3):
            for b in range(3):
                M[a, b] = G[0, a] * f.R[0, b] + G[1, a] * f.R[1, b] + G[2, a] * f.R[2, b]
        if not self.started:
            self.started = True
            self.spring.begin(f.x, M)
        for i in range(self._n):
            for a in range(3):
                self._along[a, i] = self._along[3 + a, i] = 0.0
                for b in range(3):
                    self._along[a, i] += M[a, b] * f.J[b, i]
                    self._along[3 + a, i] += _ARM_M * M[a, b] * f.J[3 + b, i]

    def _fade_spring(self, gain: Vector, dt: float) -> None:
        """Fade the spring by the force of the residual, K A^T force = `_spring`, along each of all
        axes, so that a force along a free one withstands nothing."""
        rows = self._select_rows(_ALL)
        self._rows.factor(rows, gain)
        self._rows.measure_excess(rows, self._spring)
        self._rows.correction(rows, gain, self._rows.excess, self._spring)
        for a in range(rows):
            self.spring.withstand(a, self._rows.force[a], dt)

    def _select_rows(self, which: int) -> int:
        """Rows A of the axes that are not free, of all, or of those that are held or stiff; returns
        their number."""
        r, rows = self._rows, 0
        for a in range(6):
            damps = self.spring.kind[a] == _DAMPED
            if damps and which == _HELD_ROWS:
                continue
            if which == _ALL or self.spring.kind[a] != _FREE:
                for i in range(self._n):
                    r.A[rows, i] = self._along[a, i]
                r.c[rows] = _DAMPING if damps and which == _NOT_FREE else 0.0
                r.goal[rows], r.spring[rows] = 0.0, self.spring.back[a]
                rows += 1
        return rows

    def _add_joint_limits(self, rows: int, room: Matrix, out: Vector) -> int:
        """Add a row for each joint that would pass its limit, or whose drive gives way: the others
        compensate for it, and it presses on a little. Returns the number of rows."""
        r = self._rows
        for i in range(self._n):
            if self._bound[i]:
                continue
            v = min(max(out[i], -room[0, i]), room[1, i])
            way = 1.0 if self._setpoint[i] > 0.0 else -1.0
            moves = max(way * self._motor_velocity[i], 0.0)
            if way * self._setpoint[i] > moves + _DRIVE_LAG_RAD_S and way * v > moves:
                self._press[i] = way * min(way * v - moves, _DRIVE_LAG_RAD_S)
                v = way * moves
            if abs(out[i] - v) > _TOLERANCE:
                for k in range(self._n):
                    r.A[rows, k] = 0.0
                r.A[rows, i], self._bound[i] = 1.0, 1
                r.c[rows], r.goal[rows], r.spring[rows] = 0.0, v, 0.0
                rows += 1
        return rows

    def _singularity_share(self, pivot: float, gain: Vector, out: Vector) -> float:
        """Share of the velocity at which the held rows remain independent; 1 away from there."""
        for i in range(self._n):
            self._q[i] += _LOOKAHEAD_S * out[i]
        self._update_rows()
        falls = (pivot - self._rows.factor(self._select_rows(_NOT_FREE), gain)) / _LOOKAHEAD_S
        left = max(pivot - _LEAST_PIVOT, _LEAST_LEFT)  # no jump between standing and leaving
        return float(left / (_APPROACH_S * falls)) if falls * _APPROACH_S > left else 1.0
