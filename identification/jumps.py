"""Jumps of a logged position that no joint makes: an encoder that wraps, or a single bad sample."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from common.arrays import Vector
from identification.motion_log import MotionLog

_LINK, _MOTOR = 0.5, 0.03
"""[rad] between samples: a link may snap through its gap, a motor follows its velocity."""
_ALONE = 10.0  # factor over the samples around it
_AROUND = 7  # samples
_ALIKE = 0.1
_OFTEN = 3  # equal jumps that count as an encoder's turn, whatever their size
_TURNS = (2.0 * np.pi, 1.0, 360.0)


def jumps(log: MotionLog, i: int) -> list[str]:
    """Messages about the position jumps of one joint."""
    speed = np.abs(log.motor_velocity[:, i])
    further = 1.5 * float(np.percentile(speed, 99.0)) * log.period_s  # a sample late
    columns = [("link_position", log.link_position, _LINK)]
    if log.motor_position is not None:
        columns.append(("motor_position", log.motor_position, _MOTOR + further))
    return [
        f"{name} of {log.joints[i]} jumps {about}"
        for name, values, least in columns
        if (about := _jump(log, values[:, i], log.motor_velocity[:, i], least))
    ]


def _jump(log: MotionLog, position: Vector, velocity: Vector, least: float) -> str:
    """Description of the jumps of a position (N,), with a likely cause; "" if there are none."""
    steps, moves = np.diff(log.time_s), np.diff(position)
    beyond = moves - 0.5 * (velocity[1:] + velocity[:-1]) * steps
    beyond[steps > 2.0 * log.period_s] = 0.0
    usual = median_filter(np.abs(beyond), _AROUND)
    alone = np.abs(beyond) > np.maximum(least, _ALONE * usual)
    at = np.flatnonzero(alone & (np.abs(moves) > 0.5 * np.abs(beyond)))
    if not len(at):
        return ""
    sizes = beyond[at]
    size, more = float(np.median(np.abs(sizes))), len(at) // (2 if _and_back(at, sizes) else 1) - 1
    often = f", and {more} times more" if more else ""
    about = f"by {size:.4g} rad at {log.time_s[at[0] + 1]:.4g} s"
    if _and_back(at, sizes):
        return f"{about} and back{often}: a bad sample; leave its row out"
    alike = bool((np.abs(np.abs(sizes) - size) < _ALIKE * size).all())
    if alike and (len(at) >= _OFTEN or any(abs(size - x) < _ALIKE * x for x in _TURNS)):
        return f"{about}{often}: an encoder that wraps after a turn? Log it unwrapped"
    return f"{about}{often}: did the encoder lose its position?"


def _and_back(at: NDArray[np.int64], sizes: Vector) -> bool:
    """True if each jump is undone by the next sample."""
    there, back = at[::2], at[1::2]
    return len(there) == len(back) and bool(
        (back == there + 1).all()
        and (np.abs(sizes[::2] + sizes[1::2]) < 0.5 * np.abs(sizes[::2])).all()
    )
