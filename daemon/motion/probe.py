"""Probe for a hand that rests on a yielding arm, below every level: a small swing of all joints.

At rest the levels are high, as friction that sticks may hide a torque; while a joint slides to and
fro, friction turns with its motion, and its mean over a cycle is none:

    mean of r = torque of the hand + error of the masses

So in the last part of the quiet time each joint swings at `SPEED` at most, CYCLES times by 4.6 mrad
to one side, some 2 mm at the tool. A hand is there where the mean m of the last cycle, in levels in
force, exceeds SHARE on a joint, or a force at the tool accounts for more than AT_TOOL of it, less
m0, the mean of both directions of the work before, which the masses' error leaves:

    |B^T (m - m0)| / |B|        B = J^T / level

A finding makes the arm wait, and moves nothing. It is asked for only where a hand was witnessed
(`hand_witness`): a cable, a load or friction that changed does not make an arm wait that nothing
else touched.

Pure; arrays of shape (n,).
"""

import math
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector

CYCLES: Final = 2
PERIOD_S: Final = 0.8
SPEED: Final = 0.018  # [rad/s]
SHARE: Final = 0.25  # of arms of the world's width that nothing touches, few show 0.2
AT_TOOL: Final = 0.17  # likewise 0.15
CHANGED: Final = 0.08  # of the level; a hand that holds still changes its mean by less at a time
FADED: Final = 0.7  # of what finds a hand, below which it is gone
#: A finding that sinks below SINKS at once to WEAK was friction that stuck, and slides.
SINKS, WEAK = 0.8, 1.2
#: The work: motion [rad/s], its time that is remembered, and needed each way [s], and the most that
#: it may hide, of the level: a hand may have leaned on the arm.
MOVES, REMEMBERED_S, NEEDED_S, HIDES = 0.02, 15.0, 0.5, 0.15
#: Least time without a contact before the probe: a residual fades, and the arm comes to rest [s].
FADES_S: Final = 0.3


class Probe:
    """Probe of one arm in the last of its quiet time."""

    def __init__(self, n: int, quiet_s: float) -> None:
        """quiet_s: the quiet time; one that has no room for the probe has none [s]."""
        self.velocity: Vector = np.zeros(n)
        """swing of this tick [rad/s]"""
        self._begin_s = quiet_s - CYCLES * PERIOD_S
        self._way = np.where(np.arange(n) % 2 == 0, SPEED, -SPEED)
        self._sum, self._level = np.zeros((2, n))
        self._ticks = 0  # of both
        self._mean, self._time_s = np.zeros((2, 2, n))  # of the work, each way
        self._found: tuple[int, float, float] | None = None  # joint, its mean over its level, size
        self._left: Vector | None = None  # means over levels as a hand that was found seemed gone

    def work(self, residual: Vector, velocity: Vector, dt: float) -> None:
        """Take dt [s] of the work: residual [Nm] and velocities of the motors [rad/s]."""
        ways = np.array([velocity > MOVES, velocity < -MOVES])
        self._time_s = np.minimum(self._time_s + dt * ways, REMEMBERED_S)
        self._mean += ways * (dt / np.maximum(self._time_s, dt)) * (residual - self._mean)

    def step(self, quiet_s: float, residual: Vector, threshold: Vector) -> None:
        """Take residual and level in force [Nm], quiet_s [s] after the last contact."""
        since_s = quiet_s - self._begin_s
        if since_s < 0.0 or self._begin_s < FADES_S:
            self.stop()
            return
        self.velocity = self._way * math.sin(2.0 * math.pi * since_s / PERIOD_S)
        if since_s > (CYCLES - 1) * PERIOD_S:
            self._sum += residual
            self._ticks += 1
            self._level += threshold

    def pause(self) -> None:
        """Stand where the swing is, while the quiet time does not run."""
        self.velocity = np.zeros_like(self._sum)

    def stop(self) -> None:
        """Stand, and forget the swing."""
        self.pause()
        self._sum[:] = self._level[:] = self._ticks = 0

    def hand(self, jacobian: Matrix | None = None) -> int | None:
        """Joint on which a hand rests most, over its level; None without one. One that was found
        rests on until its mean has changed, as near its limit it would come and go, and a second
        probe shows what it left. jacobian: of the tool (3, n); None, an arm without."""
        level = np.maximum(self._level, 1e-9)
        mean = self._sum / level
        known = self._time_s.min(axis=0) > NEEDED_S
        masses = self._ticks * np.where(known, self._mean.mean(axis=0), 0.0) / level
        beyond = mean - np.minimum(np.maximum(masses, -HIDES), HIDES)
        joint, size = int(np.argmax(np.abs(beyond))), float(np.abs(mean).max()) / SHARE
        if jacobian is not None and (most := np.linalg.norm(B := jacobian / level, 2)) > 0.0:
            size = max(size, float(np.linalg.norm(B @ beyond) / most) / AT_TOOL)
        before, self._found = self._found, None
        if size > 1.0:
            self._found = joint, float(beyond[joint]), size
        elif before is not None and size > FADED:
            joint, now = before[0], float(beyond[before[0]])
            self._found = (joint, now, size) if abs(now - before[1]) < CHANGED else None
        if before is not None and size < min(SINKS * before[2], WEAK):
            self._found = None
        left, self._left = self._left, None
        if before is None or (self._found is not None and (left is None or size > 1.0)):
            return None if self._found is None else self._found[0]
        # What a hand left stays; of one that moves, another probe shows something else.
        if left is not None and float(np.abs(beyond - left).max()) < CHANGED:
            self._found = None
            return None
        self._found, self._left = (before[0], float(beyond[before[0]]), size), beyond
        return before[0]

    def forget(self) -> None:
        """Forget a hand that was found."""
        self._found = self._left = None
