"""Resampling of logs of other programs to even times. Pure function."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.arrays import Matrix
from identification.motion_log import MotionLog


def on_raster(log: MotionLog, stretches: Sequence[slice], period_s: float) -> MotionLog:
    """Log interpolated every `period_s` within each of the stretches."""
    times = [np.arange(log.time_s[r.start], log.time_s[r.stop - 1], period_s) for r in stretches]

    def rastered(values: Matrix) -> Matrix:
        parts = [
            np.stack([np.interp(t, log.time_s[rows], column) for column in values[rows].T], axis=1)
            for t, rows in zip(times, stretches, strict=True)
        ]
        return np.concatenate(parts)

    return replace(
        log,
        time_s=np.concatenate(times),
        current=rastered(log.current),
        link_position=rastered(log.link_position),
        motor_velocity=rastered(log.motor_velocity),
        motor_position=None if log.motor_position is None else rastered(log.motor_position),
        setpoint=None if log.setpoint is None else rastered(log.setpoint),
    )
