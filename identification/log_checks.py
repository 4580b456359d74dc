"""Checks for logs that no arm can produce: wrong units, swapped joints, clipped encoders."""

import numpy as np

from common.arrays import Vector
from common.errors import LogError
from identification.jumps import jumps
from identification.motion_log import MotionLog

_MOVED = 0.1  # [rad]: less motion than this shows little
_STUCK = 0.1  # share of the moving time at one extreme position
_FURTHEST = 4.0 * np.pi  # [rad], two turns: no arm is excited further
_SLOWEST_S = 0.08  # between samples, at most, for the residual's filter, K of 25 /s
_BRIDGED_S = 0.15  # a longer gap between samples ends a stretch
_MILLI = 15.0  # times the largest current: a wrong unit rather than a peak
_STANDS = 1e-6  # least motion by velocity over the link's: less is no measurement
_SCALE = 0.1  # relative difference of a motor's velocity and position: filters, resolution
_SCALE_S = 0.5  # over which they are compared, so that delays and noise do not matter
_ADVANCE = 0.02  # [rad] in that time; slower, the velocity's resolution may matter


def refuse_implausible(log: MotionLog, max_current: Vector) -> None:
    """Raise LogError with everything that is wrong; max_current (n,) [A]."""
    wrong: list[str] = []
    if log.period_s > _SLOWEST_S:
        wrong.append(f"samples come every {1e3 * log.period_s:.3g} ms, at most "
                     f"{1e3 * _SLOWEST_S:g} show friction and masses: log faster (is the unit of "
                     "`time` right?)")  # fmt: skip
    for i, name in enumerate(log.joints):
        peak = float(np.abs(log.current[:, i]).max())
        if peak > 1.5 * max_current[i]:
            # Small currents are not suspicious: a motion may take a tenth of the drive's, or less.
            why = ("unit wrong by 1000 (mA, or permille)?" if peak > _MILLI * max_current[i]
                   else "is `max_current_A` its peak current, and the current in A?")  # fmt: skip
            wrong.append(f"current of {name} reaches {peak:.4g} A, its drive gives "
                         f"{max_current[i]:g} A: {why}")  # fmt: skip
        wrong += jumps(log, i) or _encoders(log, i)
    if wrong:
        raise LogError("; ".join(wrong))


def _flat(log: MotionLog, position: Vector) -> Vector:
    """Positions (N,) [rad] without the mean of each stretch, between which the link moves unseen,
    and without the common trend, which an unknown bias of the velocity adds."""
    flat, t = position.copy(), log.time_s.copy()
    for rows in log.stretches(_BRIDGED_S):
        flat[rows] -= flat[rows].mean()
        t[rows] -= t[rows].mean()
    return np.asarray(flat - t * float(t @ flat) / float(t @ t))


def _encoders(log: MotionLog, i: int) -> list[str]:
    name, q, v = log.joints[i], log.link_position[:, i], log.motor_velocity[:, i]
    theta, flat = _flat(log, _integral(log, i)), _flat(log, q)
    moved_q, moved_theta = float(np.ptp(flat)), float(np.ptp(theta))
    if max(moved_q, moved_theta) < _MOVED:
        return []
    if moved_theta <= _STANDS * moved_q:
        return [f"motor_velocity of {name} is the same throughout, while its link moves by "
                f"{moved_q:.3g} rad: is it the right column?"]  # fmt: skip
    if moved_q <= _STANDS * moved_theta:
        return [f"link_position of {name} is the same throughout, while its motor moves by "
                f"{moved_theta:.3g} rad: is it the right column?"]  # fmt: skip
    moving = np.abs(v) > 0.2 * np.abs(v).max()
    for end in (q.min(), q.max()):
        stuck = float((q[moving] == end).mean()) if moving.any() else 0.0
        if stuck > _STUCK and moved_q > 0.0:
            return [f"link_position of {name} stays at {end:.4g} rad while its motor moves: "
                    "the encoder is clipped"]  # fmt: skip
    return _scale(log, i, moved_q / moved_theta) or _apart(name, flat, theta)


def _scale(log: MotionLog, i: int, link: float) -> list[str]:
    """Message about a motor's velocity that is not the change of its position; link: motion of its
    link over that by the velocity, which shows whose scale is wrong."""
    if log.motor_position is None:
        return []
    by_position = _advances(log, log.motor_position[:, i])
    if not by_position > _ADVANCE:
        return []
    ratio = _advances(log, _integral(log, i)) / by_position
    if abs(ratio - 1.0) <= _SCALE:
        return []
    # The link moves as far as the column whose scale is right.
    off = {"motor_position": abs(np.log(link * ratio)), "motor_velocity": abs(np.log(link))}
    wrong = max(off, key=lambda column: off[column])
    return [f"motor_velocity of {log.joints[i]} is {ratio:.3g} times the change of its "
            f"motor_position: is the scale of `{wrong}` right, or `time`?"]  # fmt: skip


def _integral(log: MotionLog, i: int) -> Vector:
    """Position (N,) [rad] of a motor, integrated from its velocity."""
    v, steps = log.motor_velocity[:, i], np.diff(log.time_s, prepend=log.time_s[0])
    return np.asarray(np.cumsum(0.5 * (v + np.concatenate([v[:1], v[:-1]])) * steps))


def _advances(log: MotionLog, position: Vector) -> float:
    """Mean change [rad] of a position in `_SCALE_S`, beyond that at constant velocity."""
    width = max(round(_SCALE_S / log.period_s), 1)
    parts = [position[rows] for rows in log.stretches(_BRIDGED_S)]
    changes = np.concatenate([part[width:] - part[:-width] for part in parts])
    return float(np.abs(changes - changes.mean()).mean()) if len(changes) else 0.0


def _apart(name: str, q: Vector, theta: Vector) -> list[str]:
    """Message about link and motor (N,) [rad] that do not move alike, or move too far for an
    arm."""
    moved = float(np.ptp(q))
    ratio = moved / float(np.ptp(theta))
    if not 0.5 < ratio < 2.0:
        return [f"link_position of {name} moves {ratio:.3g} times as far as its motor: "
                f"units wrong by {_decades(ratio)}, or swapped joints?"]  # fmt: skip
    if about := too_far(name, moved):
        return [about]
    together = float(np.corrcoef(q, theta)[0, 1])
    if together < 0.8:
        return [f"link and motor of {name} do not move together (correlation {together:.2f}): "
                "swapped joints, or a wrong sign?"]  # fmt: skip
    return []


def too_far(name: str, moved: float) -> str:
    """Message about a distance [rad] that must be in another unit, or ""."""
    if moved <= _FURTHEST:
        return ""
    return (f"{name} moves by {moved:.3g} rad, an arm by at most {_FURTHEST:.3g}: are positions in "
            "degrees, or the motor's? Give units in a YAML of names beside the log")  # fmt: skip


def _decades(ratio: float) -> str:
    return f"{10.0 ** round(np.log10(max(ratio, 1e-9))):g}"
