"""Jumps of a logged position that no joint makes: an encoder that wraps, a sample that is off."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from common.arrays import Vector
from identification.motion_log import MotionLog

_LINK, _MOTOR = 0.5, 0.03
"""[rad] from one sample to the next: a link may snap through its gap, a motor turns with its
measured velocity."""
_ALONE = 10.0  # times what the samples around it do
_AROUND = 7  # samples
_ALIKE = 0.1
_OFTEN = 3  # jumps alike, that are an encoder's turn whatever it is
_TURNS = (2.0 * np.pi, 1.0, 360.0)


def jumps(log: MotionLog, i: int) -> list[str]:
    """Sentences on the positions of one joint that jump."""
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
    """Jumps of a position (N,) in words, with a likely cause; "" where there are none."""
    steps, ways = np.diff(log.time_s), np.diff(position)
    beyond = ways - 0.5 * (velocity[1:] + velocity[:-1]) * steps
    beyond[steps > 2.0 * log.period_s] = 0.0
    usual = median_filter(np.abs(beyond), _AROUND)
    alone = np.abs(beyond) > np.maximum(least, _ALONE * usual)
    at = np.flatnonzero(alone & (np.abs(ways) > 0.5 * np.abs(beyond)))
    if not len(at):
        return ""
    sizes = beyond[at]
    size, more = float(np.median(np.abs(sizes))), len(at) // (2 if _and_back(at, sizes) else 1) - 1
    often = f", and {more} times more" if more else ""
    about = f"by {size:.4g} rad at {log.time_s[at[0] + 1]:.4g} s"
    if _and_back(at, sizes):
        return f"{about} and back{often}: a sample that is off; leave its row out"
    alike = bool((np.abs(np.abs(sizes) - size) < _ALIKE * size).all())
    if alike and (len(at) >= _OFTEN or any(abs(size - x) < _ALIKE * x for x in _TURNS)):
        return f"{about}{often}: an encoder that wraps after a turn? Log it unwrapped"
    return f"{about}{often}: did the encoder lose its place?"


def _and_back(at: NDArray[np.int64], sizes: Vector) -> bool:
    """True where each jump is undone with the next sample."""
    there, back = at[::2], at[1::2]
    return len(there) == len(back) and bool(
        (back == there + 1).all()
        and (np.abs(sizes[::2] + sizes[1::2]) < 0.5 * np.abs(sizes[::2])).all()
    )
