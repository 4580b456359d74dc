# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Bounds on a setpoint as loops over joints, called and documented by `limits`.

Plain Python, which also runs uncompiled; `bounding.pxd` has the types for the compiler (decision
0037).
"""

from math import sqrt

from common.arrays import Matrix, Vector

LARGEST = 1.7976931348623157e308  # finite number


class Bounding:
    """Bounds per joint, each of shape (n,), SI units at the link side."""

    def __init__(
        self,
        lower: Vector,
        upper: Vector,
        velocity: Vector,
        acceleration: Vector,
        reaction_s: float,
    ) -> None:
        self.n = len(lower)
        self._lower, self._upper = lower.copy(), upper.copy()
        self._velocity, self._acceleration = velocity.copy(), acceleration.copy()
        self._reaction_s = reaction_s

    def bound_velocity(
        self, q: Vector, desired: Vector, before: Vector, dt: float, play: Matrix, out: Vector
    ) -> None:
        """`Limits.bound_velocity` into out (n,); play: (2, n)."""
        for i in range(self.n):
            known = before[i] + dt
            if known - known != 0.0:
                out[i] = known - known  # NaN: the drives are commanded to stop
                continue
            v = desired[i] if abs(desired[i]) <= LARGEST else 0.0
            v = min(max(v, -self._velocity[i]), self._velocity[i])
            step = self._acceleration[i] * dt
            v = min(max(v, before[i] - step), before[i] + step)
            down = self._funnel(i, q[i] - self._lower[i] - play[0, i])
            up = self._funnel(i, self._upper[i] - q[i] - play[1, i])
            out[i] = min(max(v, -down), up)

    def soft_stop(self, q: Vector, desired: Vector, gain: float, play: Matrix, out: Vector) -> None:
        """`Limits.soft_stop` into out (n,); play: (2, n)."""
        for i in range(self.n):
            down = gain * (q[i] - self._lower[i] - play[0, i])
            up = gain * (self._upper[i] - q[i] - play[1, i])
            room = down + up
            if room - room != 0.0:
                down = up = 0.0  # the position is unknown
            out[i] = max(min(desired[i], up), -down)

    def _funnel(self, i: int, distance: float) -> float:
        """`Limits.funnel` of joint i."""
        slack = 4.0 * self._reaction_s * self._acceleration[i]
        room = distance if distance > 0.0 else 0.0  # 0 for NaN
        return float(sqrt(slack * slack + 2.0 * self._acceleration[i] * room) - slack)
