"""Path of a lead: a recorded motion trimmed of rests at its ends, smoothed, and reduced to few
samples. Loops, pauses and timing stay. Pure; times (m,) [s], positions (m, k) [rad]."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from common.arrays import Matrix, Vector
from daemon.motion.trajectory_file import slopes

#: Largest displacement that counts as rest, and largest error of the reduced path [rad].
STILL_RAD: Final = 0.005
OFF_RAD: Final = 0.001
#: Length of the smoothing window, which removes tremor of the hand [s].
SMOOTHS_S: Final = 0.5


def led_path(
    times: Sequence[float], positions: Sequence[Sequence[float]]
) -> tuple[list[float], list[list[float]]]:
    """Samples of the path of a recorded motion, from time 0 on; none if nothing moved."""
    t, q = np.array(times), smoothed(np.array(times), np.array(positions))
    away, left = (np.abs(q - end).max(axis=1) > STILL_RAD for end in (q[0], q[-1]))
    if not away.any():
        return [], []
    first, last = max(int(away.argmax()) - 1, 0), len(t) - int(left[::-1].argmax())
    t, q = t[first : last + 1] - t[first], q[first : last + 1]
    kept = _kept(t, q)
    return t[kept].tolist(), q[kept].tolist()


def smoothed(t: Vector, q: Matrix) -> Matrix:
    """Mean over SMOOTHS_S around each sample, weighted by a raised cosine; positions are constant
    beyond the ends."""
    step = float(np.median(np.diff(t)))
    half = min(round(0.5 * SMOOTHS_S / step), len(t) - 1)
    window = np.hanning(2 * half + 3)[1:-1]
    padded = np.pad(q, ((half, half), (0, 0)), mode="edge")
    columns = [np.convolve(column, window / window.sum(), "valid") for column in padded.T]
    return np.array(columns).T


def _kept(t: Vector, q: Matrix) -> list[int]:
    """Rows of the reduced path: the worst row of each spline piece is added until the error is at
    most OFF_RAD."""
    kept = [0, len(t) - 1]
    while True:
        knots, piece = t[kept], np.clip(np.searchsorted(t[kept], t, "right") - 1, 0, len(kept) - 2)
        v = np.array(slopes(knots.tolist(), q[kept].tolist()))
        h = np.diff(knots)[piece]
        u = ((t - knots[piece]) / h)[:, np.newaxis]
        a, b, h = q[kept][piece], q[kept][piece + 1], h[:, np.newaxis]
        r = 3.0 * u**2 - 2.0 * u**3
        between = a + r * (b - a) + h * ((u**3 - 2.0 * u**2 + u) * v[piece])
        between += h * ((u**3 - u**2) * v[piece + 1])
        off = np.abs(between - q).max(axis=1)
        off[kept] = 0.0
        far = np.unique(piece[off > OFF_RAD]).tolist()
        worst = {int(np.argmax(np.where(piece == i, off, 0.0))) for i in far}
        if not worst:
            return kept
        kept = sorted({*kept, *worst})
