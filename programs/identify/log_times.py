"""Times of a log's rows: those logged twice or only held are left out, rounded ones spread, and
uneven ones put on a raster."""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from identification.motion_log import PAUSE_S, SHORTEST, MotionLog
from programs.recordings.raster import on_raster

_TWICE = 0.3  # share of equal neighbours, below which rows may have been logged twice
_JITTER = 0.2  # of the period: beyond it, samples are put on a raster


def once(table: dict[str, Vector]) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Columns without the rows that were logged twice: those that repeat a time, where all of them
    repeat the whole row, or where that is no rounding: spread evenly, times would move by more than
    they are rounded by."""
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
    """Columns without the rows that only hold what was measured before, of a log that was written
    faster than it was measured: everything changes with every second row, or third, and so on."""
    at = np.flatnonzero(_changed(table))
    if len(at) < SHORTEST:
        return table, ()
    least, most = np.percentile(np.diff(at), [10.0, 90.0])
    if least < 2.0 or most - least > 1.0:
        return table, ()
    number = np.arange(len(table["time"]))
    since = number - at[np.searchsorted(at, number, side="right") - 1]
    kept = since % round(most) == 0  # also where an arm stands, and nothing changes
    left = {name: values[kept] for name, values in table.items()}
    return left, (f"{(~kept).sum()} rows hold the values of the row before: left out",)


def _changed(table: dict[str, Vector]) -> NDArray[np.bool_]:
    """Rows (N,) in which anything but the time changed from the row before."""
    changed = np.zeros(len(table["time"]), dtype=np.bool_)
    changed[:1] = True
    for name, values in table.items():
        if name != "time":
            changed[1:] |= values[1:] != values[:-1]
    return changed


def spread_evenly(time_s: Vector) -> tuple[Vector, tuple[str, ...]]:
    """Times of which neighbours are equal, spread evenly: each stretch for itself, as a pause is no
    part of any period."""
    steps = np.diff(time_s)
    rounded = (steps >= 0.0).all() and (steps == 0.0).any() and (steps > 0.0).any()
    if not rounded:
        return time_s, ()
    stretches = np.split(time_s, np.flatnonzero(steps > PAUSE_S) + 1)
    spread = np.concatenate([np.linspace(t[0], t[-1], len(t)) for t in stretches])
    coarse = float(np.median(steps[steps > 0.0]))
    return spread, (f"times are rounded to {1e3 * coarse:.3g} ms: spread evenly",)


def rastered(log: MotionLog, notes: tuple[str, ...]) -> tuple[MotionLog, tuple[str, ...]]:
    """The log as it is, or where its clock jitters, interpolated every median interval."""
    period = log.period_s
    stretches = log.stretches(2.5 * period)
    steps = np.concatenate([np.diff(log.time_s[rows]) for rows in stretches])
    jitter = float(np.percentile(np.abs(steps - period), 95.0))
    if jitter <= _JITTER * period:
        return log, notes
    about = f"times jitter by {1e3 * jitter:.2g} ms: resampled every {1e3 * period:.3g} ms"
    return on_raster(log, stretches, period), (*notes, about)
