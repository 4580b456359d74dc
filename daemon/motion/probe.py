"""Probe for a hand that rests on a yielding arm, below every level: a small swing of all joints.

At rest the levels are high, as friction that sticks may hide a torque; while a joint slides to and
fro, friction turns with its motion, and its mean over a cycle is none:

    mean of r = torque of the hand + error of the masses

So in the last part of the quiet time each joint swings at `SPEED` at most, CYCLES times by 4.6 mrad
to one side, some 2 mm at the tool, and a hand is there where the mean of the last cycle exceeds
SHARE of the level in force. A finding makes the arm wait, and moves nothing. It is asked for only
where a hand was witnessed (`hand_witness`): a cable, a load or friction that changed does not make
an arm wait that nothing else touched.

Pure; arrays of shape (n,).
"""

import math
from typing import Final

import numpy as np

from common.arrays import Vector

CYCLES: Final = 2
PERIOD_S: Final = 0.8
SPEED: Final = 0.018  # [rad/s]
SHARE: Final = 0.25  # of arms of the world's width that nothing touches, few show 0.2
CHANGED: Final = 0.08  # of the level; a hand that holds still changes its mean by less at a time
FADED: Final = 0.15  # below which it is gone
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
        self._found: tuple[int, float] | None = None  # joint, and its mean over its level

    def step(self, quiet_s: float, residual: Vector, threshold: Vector) -> None:
        """Take residual and level in force [Nm], quiet_s [s] after the last contact."""
        since_s = quiet_s - self._begin_s
        if since_s < 0.0 or self._begin_s < FADES_S:
            self.stop()
            return
        self.velocity = self._way * math.sin(2.0 * math.pi * since_s / PERIOD_S)
        if since_s > (CYCLES - 1) * PERIOD_S:
            self._sum += residual
            self._level += threshold

    def pause(self) -> None:
        """Stand where the swing is, while the quiet time does not run."""
        self.velocity = np.zeros_like(self._sum)

    def stop(self) -> None:
        """Stand, and forget the swing."""
        self.pause()
        self._sum[:] = self._level[:] = 0.0

    def hand(self) -> int | None:
        """Joint on which a hand rests most, over its level; None without one. One that was found
        rests on until its mean has changed: near SHARE it would come and go."""
        share = self._sum / np.maximum(self._level, 1e-9)
        joint, before = int(np.argmax(np.abs(share))), self._found
        if abs(share[joint]) > SHARE:
            self._found = joint, float(share[joint])
        elif before is not None:
            joint, now = before[0], float(share[before[0]])
            rests = abs(now) > FADED and abs(now - before[1]) < CHANGED
            self._found = (joint, now) if rests else None
        return None if self._found is None else self._found[0]

    def forget(self) -> None:
        """Forget a hand that was found."""
        self._found = None
