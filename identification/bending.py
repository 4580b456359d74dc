"""Bending of the gear while a hand presses a link against a border of its gap.

A loaded border gives way: with a gear of 1000 Nm/rad and 3.5 Nm, phi rests 3.5 mrad beyond alpha.
While the link moves into a border, the motor torque changes by the torque that the gear transmits,
as friction keeps the sign that it had when the link passed the middle of the gap. phi over that
change is a line, which ends at alpha for zero transmitted torque.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from identification.gap_result import smoothed

USUAL, USUALLY = 1.2e-3, 0.9e-3
"""Typical compliance of gears [rad/Nm], for those that do not show theirs, and its spread."""
STIFFEST, SOFTEST = 2.5e-4, 4e-3
"""[rad/Nm]: bounds of a gear's compliance; beyond them, the torque is not that of the gear."""
_FROM = (0.3, 0.4, 0.5)
"""Shares of the largest torque from which on the line is fitted; below, borders are rounded. The
outer ones show how much the choice matters."""
_BINS, _FEWEST_BINS, _FEWEST_SAMPLES = 7, 4, 3
_FEWEST = 20
_UNSURE = 0.1  # error of the bending: neither friction nor the hand's speed is quite constant


@dataclass(frozen=True, slots=True)
class Bending:
    """alpha at zero torque, half its 95 % interval [rad], and the gear's compliance [rad/Nm]."""

    half_gap: float
    confidence: float
    compliance: float


def bending(
    time_s: Vector, phi: Vector, torque: Vector, visits_s: Vector, upper: NDArray[np.bool_]
) -> Bending | None:
    """Bending of the gear from phi [rad] and motor torque [Nm], given the times of the visits to
    its borders and whether each was the `upper` one; None if they loaded the motor too little."""
    phi, torque = smoothed(phi, 3), smoothed(torque, 3)
    low, high = np.percentile(phi, [2.0, 98.0])
    middle = 0.5 * (low + high)
    ends = np.searchsorted(time_s, visits_s)
    pressed, reached, visit = [], [], []
    for k in range(1, len(ends)):
        side = 1.0 if upper[k] else -1.0
        inside = np.flatnonzero(side * (phi[ends[k - 1] : ends[k] + 1] - middle) < 0.0)
        if not len(inside):
            continue
        begin = int(ends[k - 1] + inside[-1])
        free = torque[max(begin - 2, 0) : begin + 3].mean()
        moved = side * (phi[begin : ends[k] + 1] - middle)
        there = int(np.argmax(moved)) + 1
        pressed.append(-side * (torque[begin : begin + there] - free))
        reached.append(moved[:there])
        visit.append(np.full(there, k))
    if sum(map(len, pressed)) < _FEWEST:
        return None
    x, y, of = (np.concatenate(parts) for parts in (pressed, reached, visit))
    lines = [_line(x, y, share) for share in _FROM]
    number = len(visit)
    left_out = [_line(x[of != k], y[of != k], _FROM[1]) for k in np.unique(of)]
    if any(one is None for one in (*lines, *left_out)):
        return None
    ends_at = np.array([one[0] for one in lines if one is not None])
    others = np.array([one[0] for one in left_out if one is not None])
    error = float(np.sqrt((number - 1) / number * np.square(others - others.mean()).sum()))
    round_off = abs(float(ends_at[0] - ends_at[-1]))
    slope = next(one[1] for one in lines[1:2] if one is not None)
    bent = _UNSURE * slope * float(np.percentile(x, 95.0))
    return Bending(float(ends_at[1]), 1.96 * error + round_off + bent, slope)


def _line(pressed: Vector, reached: Vector, share: float) -> tuple[float, float] | None:
    """Offset [rad] and slope [rad/Nm] of a line through binned medians beyond a share of the
    torque; None if too few bins are filled, or the gear would bend the wrong way."""
    most = float(np.percentile(pressed, 95.0))
    if most <= 0.0:
        return None
    place = np.floor((pressed / most - share) / (1.0 - share) * _BINS)
    inner = [place == k for k in range(_BINS)]
    filled = [one for one in inner if one.sum() >= _FEWEST_SAMPLES]
    if len(filled) < _FEWEST_BINS:
        return None
    torques = np.array([np.median(pressed[one]) for one in filled])
    angles = np.array([np.median(reached[one]) for one in filled])
    slope, offset = np.polyfit(torques, angles, 1).tolist()
    return (offset, slope) if slope > 0.0 and offset > 0.0 else None
