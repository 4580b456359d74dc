# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Measures of each joint that `plausibility` compares with bounds: a row each, a loop over joints.

Plain Python, which also runs uncompiled; `measures.pxd` has the types for the compiler (decision
0037). It only detects that some measure exceeds its bound; `plausibility` reports which.
"""

import numpy as np

from common.arrays import Matrix, Vector

JUMP, OVERSPEED, TORQUE_STUCK, TORQUE_SATURATED = 0, 1, 2, 3
RESIDUAL_LIMIT, JOINT_LIMIT, FROZEN, APART = 4, 5, 6, 7
ROWS = 8


def within(a: Vector, b: Vector, bound: Vector) -> bool:
    """True if |a - b| <= bound for all elements; each (n,)."""
    good = True
    for i in range(a.shape[0]):
        good = good and abs(a[i] - b[i]) <= bound[i]
    return good


class Measures:
    """Measures and bounds (ROWS, n), SI at the link side, and the state behind them."""

    def __init__(
        self,
        bounds: Matrix,
        *,
        middle: Vector,
        play: Vector,
        full_current: Vector,
        speed: Vector,
        standstill: float,
        motor_drift: float,
        motor_scale_error: float,
    ) -> None:
        """bounds: (ROWS, n). middle: of each joint's range [rad]; play: of each gap [rad];
        full_current: from which on a drive is at its limit [A]; speed: limit of motor and link
        [rad/s]; standstill: speed below which they are at rest [rad/s]; motor_drift,
        motor_scale_error: error of an integrated motor position, absolute [rad/s] and relative.
        """
        n = self.n = bounds.shape[1]
        self.bounds = bounds.copy()
        self._middle, self._play = middle.copy(), play.copy()
        self._full, self._speed = full_current.copy(), speed.copy()
        self._standstill = standstill
        self._drift, self._scale_error = motor_drift, motor_scale_error
        self.measures = np.zeros((ROWS, n))
        self.q, self.q_before, self.current, self.velocity, self.dt = np.zeros((5, n))
        # Consecutive ticks at the current limit, above the speed limit, with an unchanged current.
        self.full_ticks, self.fast_ticks, self.same_ticks = np.zeros((3, n))
        self._theta, self._lowest, self._highest = np.zeros((3, n))  # extremes of q - theta
        self._turned, self._turned_stuck = np.zeros((2, n))  # travel with the same q, same current
        self._begun = np.zeros(n, dtype=np.uint8)

    def restart(self) -> None:
        """Discard earlier samples: the next ones are accepted without comparison."""
        for i in range(self.n):
            self._begun[i] = 0

    def step(
        self,
        q: Vector,
        motor_velocity: Vector,
        motor_position: Vector | None,
        current: Vector,
        residual: Vector,
        dt: Vector,
        energised: bool,
    ) -> bool:
        """Process samples dt (n,) [s] after the previous ones, 0 where there is none. True if a
        measure exceeds its bound. A joint starts with its first samples that are all finite."""
        beyond = False
        for i in range(self.n):
            everything = q[i] + motor_velocity[i] + current[i]
            if motor_position is not None:
                everything += motor_position[i]
            if everything - everything != 0.0:
                self._begun[i] = 0
                for row in range(ROWS):
                    self.measures[row, i] = 0.0
                continue
            self.q_before[i], self.q[i] = self.q[i], q[i]
            if motor_position is None:
                advance = self._integrated(i, motor_velocity[i], dt[i])
            else:
                advance = motor_position[i] - self._theta[i]
                self._theta[i] = motor_position[i]
            same = current[i] == self.current[i]
            self.current[i], self.velocity[i], self.dt[i] = current[i], motor_velocity[i], dt[i]
            if not self._begun[i]:
                self._begun[i] = 1
                self._start(i)
                advance, same = 0.0, True
            self._follow_gap(i, advance, same)
            if energised:
                self._follow_motion(i, advance, same, abs(residual[i]))
            else:
                for row in range(FROZEN):
                    self.measures[row, i] = 0.0
                self.full_ticks[i] = self.fast_ticks[i] = self.same_ticks[i] = 0.0
                self._turned_stuck[i] = 0.0
            for row in range(ROWS):
                beyond = beyond or self.measures[row, i] > self.bounds[row, i]
        return beyond

    def _integrated(self, i: int, velocity: float, dt: float) -> float:
        """Advance theta by the integral of the velocity; returns the increment."""
        advance = velocity * dt if abs(velocity) > self._standstill else 0.0
        self._theta[i] += advance
        # The integral drifts: old extremes of phi say less and less about the gap.
        drift = self._drift * dt + self._scale_error * abs(advance)
        # Below standstill the motor may turn, or its velocity be biased: both are allowed for.
        drift += abs(velocity * dt - advance)
        self._highest[i] -= drift
        self._lowest[i] += drift
        return advance

    def _start(self, i: int) -> None:
        self.q_before[i] = self.q[i]
        self._lowest[i] = self._highest[i] = self.q[i] - self._theta[i]
        self._turned[i] = self._turned_stuck[i] = 0.0
        self.full_ticks[i] = self.fast_ticks[i] = self.same_ticks[i] = 0.0

    def _follow_gap(self, i: int, advance: float, same: bool) -> None:
        """Measures of the gap, also valid for an arm that is moved by hand."""
        phi = self.q[i] - self._theta[i]
        self._highest[i] = max(self._highest[i], phi)
        self._lowest[i] = min(self._lowest[i], phi)
        self._turned[i] = self._turned[i] + advance if self.q[i] == self.q_before[i] else 0.0
        self._turned_stuck[i] = self._turned_stuck[i] + advance if same else 0.0
        self.measures[APART, i] = self._highest[i] - self._lowest[i]
        self.measures[FROZEN, i] = abs(self._turned[i])

    def _follow_motion(self, i: int, advance: float, same: bool, residual: float) -> None:
        """Measures that are valid only while the drives have power."""
        arrived = 1.0 if self.dt[i] > 0.0 else 0.0
        full, fast = abs(self.current[i]) >= self._full[i], abs(self.velocity[i]) >= self._speed[i]
        self.full_ticks[i] = self.full_ticks[i] + arrived if full else 0.0
        self.fast_ticks[i] = self.fast_ticks[i] + arrived if fast else 0.0
        self.same_ticks[i] = self.same_ticks[i] + arrived if same else 0.0
        self.bounds[JUMP, i] = self._speed[i] * self.dt[i] + self._play[i]
        self.measures[JUMP, i] = abs(self.q[i] - self.q_before[i] - advance)
        self.measures[OVERSPEED, i] = self.fast_ticks[i]
        self.measures[TORQUE_STUCK, i] = abs(self._turned_stuck[i])
        self.measures[TORQUE_SATURATED, i] = self.full_ticks[i]
        self.measures[RESIDUAL_LIMIT, i] = residual
        self.measures[JOINT_LIMIT, i] = abs(self.q[i] - self._middle[i])
