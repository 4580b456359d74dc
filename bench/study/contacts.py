"""Count of true against detected contacts, joint by joint. Pure functions."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from common.arrays import Matrix, Vector

FADE_S = 0.3  # After a release the residual decays, and the link swings back in its gap.


@dataclass(frozen=True, slots=True)
class Stretch:
    """Ticks begin <= k < end in which a signal has one sign."""

    begin: int
    end: int
    sign: int
    peak: float  # largest magnitude


@dataclass(slots=True)
class Count:
    """Contacts of one joint."""

    detected: int = 0
    missed: int = 0
    false: int = 0
    delays_s: list[float] = field(default_factory=list)  # after reaching `level`, or before (< 0)


def stretches(signal: Vector) -> list[Stretch]:
    """All stretches (ticks,) of one sign; zeros belong to none."""
    sign = np.sign(signal).astype(int)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], sign, [0])))).tolist()
    return [
        Stretch(begin, end, int(sign[begin]), float(np.abs(signal[begin:end]).max()))
        for begin, end in pairwise(edges)
        if sign[begin]
    ]


def count_joint(
    torque: Vector, thresholded: Vector, level: float, period_s: float, fade_s: float = FADE_S
) -> Count:
    """Contacts of one joint, from its true external torque (ticks,) and thresholded residual
    (ticks,), both [Nm].

    A contact, a stretch of torque of one sign, is detected if the residual shows that sign before
    it ends. It is missed if not, although it reaches `level` [Nm]; a smaller one need not be
    detected. A detection is false if it begins neither in a contact of its sign nor within `fade_s`
    after one.
    """
    count = Count()
    fade = round(fade_s / period_s)
    touches, detected = stretches(torque), stretches(thresholded)
    for touch in touches:
        during = (f for f in detected if f.sign == touch.sign and f.end > touch.begin)
        first = min((max(f.begin, touch.begin) for f in during), default=touch.end)
        reached = touch.begin + int(np.argmax(np.abs(torque[touch.begin : touch.end]) >= level))
        if first < touch.end:
            count.detected += 1
            if touch.peak >= level:
                count.delays_s.append(round((first - reached) * period_s, 6))
        else:
            count.missed += touch.peak >= level
    count.false = sum(
        not any(t.sign == f.sign and t.begin <= f.begin < t.end + fade for t in touches)
        for f in detected
    )
    return count


def count_contacts(
    torque: Matrix, thresholded: Matrix, levels: Sequence[float], period_s: float
) -> list[Count]:
    """`count_joint` for every column."""
    return [
        count_joint(torque[:, i], thresholded[:, i], level, period_s)
        for i, level in enumerate(levels)
    ]
