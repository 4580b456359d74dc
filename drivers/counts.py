# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Conversion between PDO counts and SI values at the link side: loops over all joints.

Ordinary Python that also runs uncompiled; `counts.pxd` declares the C types (decision 0037).
"""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.elementary import cosine, sine

Table = NDArray[np.float64]

# Adding and subtracting 1.5 * 2^52 rounds to an integer, ties to even.
_ROUNDING = 6755399441055744.0
_LARGEST = 1.7976931348623157e308  # largest finite double


def decode(raw: list[float], order: Matrix, gain: Matrix, bias: Matrix, values: Matrix) -> None:
    """values = gain * raw[order] + bias, each (m, n)."""
    for row in range(values.shape[0]):
        for i in range(values.shape[1]):
            values[row, i] = gain[row, i] * raw[order[row, i]] + bias[row, i]


def correct(position: Vector, offset: Vector, harmonics: Table) -> None:
    """Subtract the periodic encoder error from positions (n,) [rad], in place. harmonics (n, k, 3):
    order, and the cosine and sine amplitudes [rad] at that multiple of the angle without offset."""
    for i in range(harmonics.shape[0]):
        angle, error = position[i] - offset[i], 0.0
        for k in range(harmonics.shape[1]):
            turned = harmonics[i, k, 0] * angle
            error += harmonics[i, k, 1] * cosine(turned) + harmonics[i, k, 2] * sine(turned)
        position[i] -= error


def encode(
    velocity: Vector, gain: Vector, bias: Vector, lowest: Vector, highest: Vector, counts: Vector
) -> bool:
    """counts = (velocity - bias) / gain, each (n,), rounded to the nearest, ties to even, and
    saturated. False if a velocity is not finite: the counts are invalid then."""
    finite = True
    for i in range(velocity.shape[0]):
        finite = finite and abs(velocity[i]) <= _LARGEST
        wanted = min(max((velocity[i] - bias[i]) / gain[i], lowest[i]), highest[i])
        counts[i] = (wanted + _ROUNDING) - _ROUNDING
    return finite
