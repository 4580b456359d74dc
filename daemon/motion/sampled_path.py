"""Path through samples: cubic Hermite between knots (time, position, velocity), so that position
and velocity are continuous and the extremes of every piece are known exactly.

It is built from chunks of rows, each checked when it comes: a bounded number of rows takes a
bounded amount of work. Pure; arrays of shape (m, n), one row per knot, SI units.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import TrajectoryError
from daemon.motion.limits import Limits
from daemon.motion.path import ROUNDING
from daemon.motion.trajectory_file import MAX_ROWS, SHORTEST_STEP_S, refuse_columns
from daemon.protocol.bounds import PLAUSIBLE

Tensor = NDArray[np.float64]

# Rows of a block: few blocks to search, and short ones to copy when they grow.
BLOCK_ROWS = 512


@dataclass(frozen=True, slots=True)
class _Block:
    """Consecutive knots, the first of which is the last of the previous block; and the lowest and
    highest positions and the largest speed between them, (n,)."""

    times: Vector  # (m,)
    knots: Tensor  # (m, 2, n): position and velocity
    low: Vector
    high: Vector
    fast: Vector


class SampledPath:
    """Cubic Hermite pieces as a JointPath: displacements from the first knot."""

    def __init__(
        self,
        name: str,
        blocks: Sequence[_Block],
        named: NDArray[np.bool_],
        *,
        from_here: bool,
        motors_only: bool = False,
    ) -> None:
        self.name, self.motors_only, self.halts_at_contact = name, motors_only, False
        self._blocks = tuple(blocks)
        self._starts = [float(block.times[0]) for block in blocks]
        self._first = blocks[0].knots[0, 0]
        self.duration = float(blocks[-1].times[-1])
        self.begin = None if from_here else np.where(named, self._first, np.nan)
        # Extremes of each block and all later ones.
        low = np.array([block.low for block in blocks]) - self._first
        high = np.array([block.high for block in blocks]) - self._first
        self._low = np.minimum.accumulate(low[::-1])[::-1]
        self._high = np.maximum.accumulate(high[::-1])[::-1]
        fast = np.array([block.fast for block in blocks])
        self._fast = np.maximum.accumulate(fast[::-1])[::-1]

    def continued_from(self, q: Vector) -> "SampledPath":
        """Itself: its displacements continue from any pose."""
        del q
        return self

    def offset(self, s: float) -> Vector:
        """Displacement [rad] from the first knot at path time s [s]; (n,)."""
        h, u, ends = self._piece(s)
        u2, u3 = u * u, u * u * u
        r = 3.0 * u2 - 2.0 * u3
        weights = np.array([1.0 - r, h * (u3 - 2.0 * u2 + u), r, h * (u3 - u2)])
        displacement: Vector = weights @ ends - self._first
        return displacement

    def slope(self, s: float) -> Vector:
        """d offset / d s [rad/s]; (n,)."""
        h, u, ends = self._piece(s)
        u2 = u * u
        r = 6.0 * (u - u2) / h
        weights = np.array([-r, 3.0 * u2 - 4.0 * u + 1.0, r, 3.0 * u2 - 2.0 * u])
        velocity: Vector = weights @ ends
        return velocity

    def extent(self, s: float) -> tuple[Vector, Vector]:
        """Lowest and highest offset from the block of path time s on."""
        i = self._block(s)
        return self._low[i], self._high[i]

    def fastest(self, s: float) -> Vector:
        """Largest speed [rad/s] from the block of path time s on."""
        speed: Vector = self._fast[self._block(s)]
        return speed

    def _block(self, s: float) -> int:
        return max(bisect_right(self._starts, s) - 1, 0)

    def _piece(self, s: float) -> tuple[float, float, Matrix]:
        """Piece at s: its length [s], the share of it before s, and its ends (4, n): position and
        velocity of the first, then of the second."""
        block = self._blocks[self._block(s)]
        j = int(block.times.searchsorted(s, side="right")) - 1
        j = min(max(j, 0), len(block.times) - 2)
        start = float(block.times[j])
        h = float(block.times[j + 1]) - start
        u = min(max((s - start) / h, 0.0), 1.0)
        return h, u, block.knots[j : j + 2].reshape(4, -1)


class PathBuilder:
    """Builder of a SampledPath, which takes rows in chunks, and refuses those beyond a limit.

    `columns` are the joints that the rows name, in the rows' order; all others hold. Rows are
    [t, q of each column, q_dot of each column]. Raises TrajectoryError for an unknown, doubled or
    missing column.
    """

    def __init__(
        self,
        name: str,
        joints: Sequence[str],
        columns: Sequence[str],
        limits: Limits,
        ramp_s: float,
        *,
        from_here: bool = False,
        motors_only: bool = False,
    ) -> None:
        refuse_columns(columns, joints)
        self._motors_only = motors_only
        self.name, self.rows = name, 0
        self._joints, self._limits, self._ramp_s = tuple(joints), limits, ramp_s
        self._from_here = from_here
        self._columns = np.array([self._joints.index(column) for column in columns])
        self._named = np.zeros(len(joints), dtype=np.bool_)
        self._named[self._columns] = True
        self._blocks: list[_Block] = []
        self._last: tuple[Vector, Tensor] | None = None  # time and knot, (1,) and (1, 2, n)
        self._start_s = 0.0

    def append(self, rows: Sequence[Sequence[float]]) -> None:
        """Check and add the next rows. Raises TrajectoryError with the row (counted from 0 over
        all chunks) and the reason; nothing of this chunk is added then."""
        if self.rows + len(rows) > MAX_ROWS:
            raise TrajectoryError(f"more than {MAX_ROWS} rows", row=MAX_ROWS)
        if not rows:
            return
        times, knots = self._knots_of(rows)
        first_row = self.rows
        # A single knot forms a piece only with the previous one.
        if self._last is not None:
            times = np.concatenate([self._last[0], times])
            knots = np.concatenate([self._last[1], knots])
            first_row -= 1
        if len(times) > 1:
            self._keep(times, knots, *self._checked(times, knots, first_row))
        self._last = times[-1:], knots[-1:]
        self.rows += len(rows)

    def finish(self) -> SampledPath:
        """Complete path. Raises TrajectoryError if there are fewer than two rows."""
        if not self._blocks:
            raise TrajectoryError(f"{self.rows} rows of samples; a trajectory needs two or more")
        return SampledPath(
            self.name,
            self._blocks,
            self._named,
            from_here=self._from_here,
            motors_only=self._motors_only,
        )

    def _keep(self, times: Vector, knots: Tensor, low: Vector, high: Vector, fast: Vector) -> None:
        """Store knots as a new block, or in the last one while that is short."""
        if self._blocks and len(self._blocks[-1].times) < BLOCK_ROWS:
            block = self._blocks.pop()
            times = np.concatenate([block.times, times[1:]])
            knots = np.concatenate([block.knots, knots[1:]])
            low, high = np.minimum(block.low, low), np.maximum(block.high, high)
            fast = np.maximum(block.fast, fast)
        self._blocks.append(_Block(times, knots, low, high, fast))

    def _knots_of(self, rows: Sequence[Sequence[float]]) -> tuple[Vector, Tensor]:
        """Rows as times from the trajectory's beginning (m,) and knots of all joints
        (m, 2, n)."""
        k, n = len(self._columns), len(self._joints)
        wrong = next((i for i, row in enumerate(rows) if len(row) != 1 + 2 * k), None)
        if wrong is not None:
            text = f"{len(rows[wrong])} numbers instead of {1 + 2 * k}: time, positions, velocities"
            raise TrajectoryError(text, row=self.rows + wrong)
        table = np.array(rows, dtype=np.float64)
        good = np.abs(table) <= PLAUSIBLE  # false for NaN
        if not good.all():
            i, j = divmod(int(np.argmin(good)), table.shape[1])
            where = "time_s" if j == 0 else self._joints[self._columns[(j - 1) % k]]
            text = f"{where}: {table[i, j]} is not a number of at most {PLAUSIBLE:g}"
            raise TrajectoryError(text, row=self.rows + i)
        if self.rows == 0:
            self._start_s = float(table[0, 0])
        knots = np.zeros((len(rows), 2, n))
        knots[:, :, self._columns] = table[:, 1:].reshape(len(rows), 2, k)
        return table[:, 0] - self._start_s, knots

    def _checked(
        self, times: Vector, knots: Tensor, first_row: int
    ) -> tuple[Vector, Vector, Vector]:
        """Lowest and highest position and largest speed between the knots, (n,); raises
        TrajectoryError at the first row that violates a limit."""
        h = np.diff(times)[:, None]
        if (h < SHORTEST_STEP_S).any():
            i = int(np.argmax(h < SHORTEST_STEP_S))
            ahead, behind = times[i : i + 2] + self._start_s
            text = f"time_s: {behind:g} does not come after {ahead:g}"
            raise TrajectoryError(text, row=first_row + i + 1)
        speed = np.abs(np.diff(knots[:, 0], axis=0)) / h
        low, high, velocity, acceleration = _piece_extremes(knots, h)
        limits = self._limits
        # The soft start or stop may fall on any piece: d/dt (q' ds/dt) = q'' (ds/dt)^2 + q' / ramp.
        acceleration = acceleration + velocity / self._ramp_s
        # In the order in which they explain each other: a jump violates them all.
        self._refuse(
            speed > limits.velocity + ROUNDING,
            first_row,
            lambda i, j: (
                f"jumps by {speed[i, j] * h[i, 0]:.4g} rad in {h[i, 0]:.4g} s: "
                f"{speed[i, j]:.3g} rad/s is above the limit {limits.velocity[j]:g}"
            ),
        )
        outside = (low < limits.lower - ROUNDING) | (high > limits.upper + ROUNDING)
        if not self._from_here:
            self._refuse(
                outside & self._named,
                first_row,
                lambda i, j: (
                    f"reaches {low[i, j] if low[i, j] < limits.lower[j] else high[i, j]:.4g} rad, "
                    f"outside its limits [{limits.lower[j]:g}, {limits.upper[j]:g}]"
                ),
            )
        self._refuse(
            velocity > limits.velocity + ROUNDING,
            first_row,
            lambda i, j: (
                f"reaches {velocity[i, j]:.3g} rad/s before this sample, "
                f"above the limit {limits.velocity[j]:g}"
            ),
        )
        self._refuse(
            acceleration > limits.acceleration + ROUNDING,
            first_row,
            lambda i, j: (
                f"reaches {acceleration[i, j]:.3g} rad/s2 before this sample (a soft start "
                f"included), above the limit {limits.acceleration[j]:g}"
            ),
        )
        return low.min(axis=0), high.max(axis=0), velocity.max(axis=0)

    def _refuse(
        self, broken: NDArray[np.bool_], first_row: int, why: Callable[[int, int], str]
    ) -> None:
        if broken.any():
            i, j = divmod(int(np.argmax(broken)), broken.shape[1])
            raise TrajectoryError(f"{self._joints[j]}: {why(i, j)}", row=first_row + i + 1)


def _piece_extremes(knots: Tensor, h: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Extremes of each cubic piece: lowest and highest position, largest speed and acceleration,
    each (m - 1, n); h (m - 1, 1) are the lengths [s].

    In u = 0 ... 1 the velocity is a u^2 + b u + v0 with its extreme where the acceleration, which
    is linear, is zero; the position has its extremes where the velocity is zero.
    """
    q, v = knots[:, 0], knots[:, 1]
    q0, q1, v0, v1 = q[:-1], q[1:], v[:-1], v[1:]
    mean = (q1 - q0) / h
    a = 3.0 * (v0 + v1 - 2.0 * mean)
    b = 2.0 * (3.0 * mean - 2.0 * v0 - v1)
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = _inside(-b / (2.0 * a))
        root = np.sqrt(np.maximum(b * b - 4.0 * a * v0, 0.0))
        # Form of the roots without cancellation, also valid for a = 0.
        half = -0.5 * (b + np.copysign(root, b))
        zeros = (_inside(half / a), _inside(v0 / half))
    speed = np.maximum(np.maximum(np.abs(v0), np.abs(v1)), np.abs(a * peak * peak + b * peak + v0))
    acceleration = np.maximum(np.abs(b), np.abs(2.0 * a + b)) / h
    low, high = np.minimum(q0, q1), np.maximum(q0, q1)
    for u in zeros:
        there = q0 + h * u * (v0 + u * (b / 2.0 + u * a / 3.0))
        low, high = np.minimum(low, there), np.maximum(high, there)
    return low, high, speed, acceleration


def _inside(u: Matrix) -> Matrix:
    """u where it is inside the piece, else 0, its beginning."""
    return np.where((u > 0.0) & (u < 1.0), u, 0.0)
