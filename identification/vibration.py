"""Vibration in a log's torques: what links, rotors and friction do not explain, by its frequency.

Currents are fitted as x = s tau + c sign(v) + d v + B a + b. If the remainder has a peak above the
frequencies of motion that exceeds the friction, currents are low-passed below it, forwards and
backwards, and so without a delay.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.signal import butter, sosfiltfilt, welch

from common.arrays import Vector
from estimator.model import Model
from estimator.settings import EstimatorSettings
from identification.log_intervals import intervals, low_pass
from identification.motion_log import MotionLog
from identification.torque_columns import torque_parts

_ROWS: Final = 10_000  # rows of a log that are used
_GAIN: Final = 30.0  # of the filter on both sides of the fit [1/s]
_LOWEST_HZ: Final = 4.0  # motion and friction are below
_WINDOW_S: Final = 4.0
_FILTERED_FROM: Final = 1.0  # ratio to the friction from which on vibration is filtered out
_WIDE, _TONE = 0.3, 0.6  # octaves about its peak, and share of the power there


def without_vibration(
    log: MotionLog, model: Model, settings: EstimatorSettings, constants: Vector
) -> tuple[MotionLog, tuple[str, ...]]:
    """The log with currents free of vibration, and a message on what was removed, if anything;
    constants (n,) [Nm/A]."""
    rows = intervals(log.select(slice(0, _ROWS)), model, settings)
    rate_Hz = 1.0 / rows.period_s
    if rate_Hz < 4.0 * _LOWEST_HZ:
        return log, ()
    width = min(round(_WINDOW_S * rate_Hz), len(rows.dt))
    current, about = log.current.copy(), []
    for i, joint in enumerate(log.joints):
        x = rows.current[:, i]
        smooth = low_pass(torque_parts(rows, i), rows, _GAIN)
        found, *_ = np.linalg.lstsq(smooth, low_pass(x[:, None], rows, _GAIN)[:, 0], rcond=None)
        f, of_all = welch(x, rate_Hz, nperseg=width)
        _, explained = welch(smooth @ found, rate_Hz, nperseg=width)
        left = np.maximum(of_all - explained, 0.0) * (f >= _LOWEST_HZ)
        peak = float(f[np.argmax(left)])
        around = float(left[np.abs(np.log2(np.maximum(f, f[1]) / max(peak, f[1]))) < _WIDE].sum())
        size, edge = float(np.sqrt(2.0 * around * f[1])), 0.7 * peak
        tone = around > _TONE * float(left.sum())  # unlike a gap's crossings
        if tone and size > _FILTERED_FROM * abs(found[1]) > 0.0 and edge > _LOWEST_HZ:
            sos = butter(4, edge, fs=1.0 / log.period_s, output="sos")
            for part in log.stretches():
                if part.stop - part.start > 30:
                    current[part, i] = sosfiltfilt(sos, log.current[part, i])
            about.append(f"{joint} {size * constants[i]:.2g} Nm above {edge:.2g} Hz")
    if not about:
        return log, ()
    note = f"vibration drowns friction, and was filtered out of currents: {', '.join(about)}"
    return replace(log, current=current), (note,)
