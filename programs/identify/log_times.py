"""Clean-up of a log's times: removes duplicated and held rows, spreads rounded times evenly, and
resamples uneven ones."""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from identification.motion_log import PAUSE_S, SHORTEST, MotionLog
from programs.recordings.raster import on_raster

_TWICE = 0.3  # share of repeated times up to which rows may have been logged twice
_JITTER = 0.2  # jitter, over the period, above which samples are resampled


def once(table: dict[str, Vector]) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Columns without rows that were logged twice. Rows that repeat a time count as such if all of
    them repeat the whole row, or if rounding does not explain them: spreading the times evenly
    would move them by more than the rounding."""
    time_s = table["time"]
    again = np.diff(time_s, prepend=-np.inf) == 0.0
    even, notes = spread_evenly(time_s)
    if not notes:
        return table, ()
    if _changed(table)[again].any():
        if again.mean() > _TWICE:
            return table, ()
        steps = np.diff(time_s)
        if np.abs(even - time_s).max() <= float(np.median(steps[steps > 0.0])):
            return table, ()
    left = {name: values[~again] for name, values in table.items()}
    return left, (f"{again.sum()} rows repeat the time of the row before: left out",)


def unheld(table: dict[str, Vector]) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Columns without rows that only repeat the last measurement, for a log that was written faster
    than measured: values change only with every second row, or third, and so on."""
    at = np.flatnonzero(_changed(table))
    if len(at) < SHORTEST:
        return table, ()
    least, most = np.percentile(np.diff(at), [10.0, 90.0])
    if least < 2.0 or most - least > 1.0:
        return table, ()
    number = np.arange(len(table["time"]))
    since = number - at[np.searchsorted(at, number, side="right") - 1]
    kept = since % round(most) == 0  # keeps the rate while the arm stands and nothing changes
    left = {name: values[kept] for name, values in table.items()}
    return left, (f"{(~kept).sum()} rows repeat the values of the row before: left out",)


def _changed(table: dict[str, Vector]) -> NDArray[np.bool_]:
    """Mask (N,) of rows in which any value but the time differs from the row before."""
    changed = np.zeros(len(table["time"]), dtype=np.bool_)
    changed[:1] = True
    for name, values in table.items():
        if name != "time":
            changed[1:] |= values[1:] != values[:-1]
    return changed


def spread_evenly(time_s: Vector) -> tuple[Vector, tuple[str, ...]]:
    """Times with equal neighbours, spread evenly within each stretch, as a pause belongs to no
    period."""
    steps = np.diff(time_s)
    rounded = (steps >= 0.0).all() and (steps == 0.0).any() and (steps > 0.0).any()
    if not rounded:
        return time_s, ()
    stretches = np.split(time_s, np.flatnonzero(steps > PAUSE_S) + 1)
    spread = np.concatenate([np.linspace(t[0], t[-1], len(t)) for t in stretches])
    coarse = float(np.median(steps[steps > 0.0]))
    return spread, (f"times are rounded to {1e3 * coarse:.3g} ms: spread evenly",)


def rastered(log: MotionLog, notes: tuple[str, ...]) -> tuple[MotionLog, tuple[str, ...]]:
    """Log as it is, or if its clock jitters, resampled at the median interval."""
    period = log.period_s
    stretches = log.stretches(2.5 * period)
    steps = np.concatenate([np.diff(log.time_s[rows]) for rows in stretches])
    jitter = float(np.percentile(np.abs(steps - period), 95.0))
    if jitter <= _JITTER * period:
        return log, notes
    about = f"times jitter by {1e3 * jitter:.2g} ms: resampled every {1e3 * period:.3g} ms"
    return on_raster(log, stretches, period), (*notes, about)
