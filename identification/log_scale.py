"""Check for logs whose times or positions have a wrong scale or sign in all columns alike.

The columns agree with each other then, and bodies, rotors and friction of another arm fit them. But
gravity depends on the pose, inertia on the square of the speed, and friction on its sign: scaled to
what it should have been, such a log is explained better where it was not fitted.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import LogError
from estimator.model import Model
from estimator.settings import EstimatorSettings
from estimator.transmission import Transmission
from identification.body_motion import body_motion, rows_of_joints
from identification.body_rows import fitted
from identification.motion_log import MotionLog
from identification.possible_bodies import possible
from identification.regression import HELD_OUT

_ROWS: Final = 2000  # of a log that are used
_FACTORS: Final = (0.5**0.5, 2.0**0.5)
_NOTHING: Final = 1e-9  # [Nm]
_BETTER: Final = 0.85
"""|r| over that of the log as it is: 0.95 and more of right logs, 0.19 to 0.78 of wrong ones."""


def refuse_other_scale(
    log: MotionLog, model: Model, t: Transmission, settings: EstimatorSettings, max_current: Vector
) -> None:
    """Raise LogError if held-out motion is explained better in another scale; max_current (n,)."""

    def left(scaled: MotionLog) -> Matrix:
        """Logarithms (2, n) of |r| [Nm] by bodies and friction fitted to the rest: on the end of
        the motion, and on its beginning."""
        motion = body_motion(scaled, model, settings, max_current, t.sign_width, 0.0)
        massive = np.flatnonzero(model.parameters()[:, 0] > 0.0)
        nominal = np.array([possible(row) for row in model.parameters()[massive]])
        bodies = motion.regressor[:, :, massive].reshape(len(motion.rows.dt), log.n, -1)
        shift = bodies @ (nominal - model.parameters()[massive]).ravel()
        every = np.ones(log.n, dtype=np.bool_)
        joints = rows_of_joints(motion, bodies, t, settings, np.zeros_like(motion.cut), every)
        joints = [replace(one, torque=one.torque - shift[:, i]) for i, one in enumerate(joints)]
        place, rms = np.arange(len(bodies)) / len(bodies), []
        for tested in (place >= 1.0 - HELD_OUT, place < HELD_OUT):
            fit = fitted(joints, ~tested, nominal, motion.rows.period_s)
            pairs = zip(joints, fit.friction, strict=True)
            rms.append([one.rms(fit.difference, x, tested) for one, x in pairs])
        return np.asarray(np.log(np.maximum(rms, _NOTHING)))

    seen = log.select(slice(0, _ROWS))
    usual = left(seen)
    known = np.isfinite(usual).all(axis=0)
    if not known.any():
        return
    ratios = {}
    for one, words in _scaled(seen):
        ratio = float(np.exp((left(one) - usual)[:, known].mean(axis=1).max()))
        ratios[words] = ratio if ratio >= 0.0 else np.inf  # NaN: too little counted
    words = min(ratios, key=lambda name: ratios[name])
    if ratios[words] < _BETTER:
        raise LogError(f"with {words} the log's motion leaves {ratios[words]:.2f} times the "
                       "residual, held out: check units, signs and zeros of its columns, and the "
                       "URDF's axes")  # fmt: skip


def _scaled(log: MotionLog) -> Iterator[tuple[MotionLog, str]]:
    """Logs in other scales, each with words on it."""
    every = np.ones(log.n)
    for factor in _FACTORS:
        yield _with(log, factor * every), f"all positions multiplied by {factor:.2g}"
        for more in (factor, factor * factor):
            yield _with(log, every, more), f"times multiplied by {more:.2g}"
    for i, name in enumerate(log.joints):
        for factor in _FACTORS:
            scale = np.where(np.arange(log.n) == i, factor, 1.0)
            yield _with(log, scale), f"positions of {name} multiplied by {factor:.2g}"
        scale = np.where(np.arange(log.n) == i, -1.0, 1.0)
        yield _with(log, scale), f"positions and currents of {name} reversed"


def _with(log: MotionLog, scale: Vector, time: float = 1.0) -> MotionLog:
    """Log with scaled positions (n,) and times, and currents with the signs of the positions."""
    motor = None if log.motor_position is None else scale * log.motor_position
    return replace(
        log, time_s=time * log.time_s, current=np.sign(scale) * log.current,
        link_position=scale * log.link_position, motor_position=motor,
        motor_velocity=scale / time * log.motor_velocity,
    )  # fmt: skip
