"""Array types used throughout the project, and shape checks for arguments of compiled loops."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""float64 array of shape (n,) unless stated otherwise: one entry per joint, SI, at the link
side."""

Matrix = NDArray[np.float64]
"""float64 array of shape (rows, n) or (n, n); rows are ticks, milliseconds, or as stated."""


def check_shapes(shape: Sequence[int], **given: Any) -> None:
    """Raise ValueError for an array whose shape differs from `shape`: a compiled loop does not
    check its bounds, and would read or write past the end."""
    for name, value in given.items():
        if getattr(value, "shape", None) != shape:
            found = getattr(value, "shape", type(value).__name__)
            raise ValueError(f"{name} is {found}; it must be an array of shape {shape}")


def product(a: Matrix, b: Matrix) -> Matrix:
    """Matrix products a @ b for shapes (..., 3, 3), or (..., 3, 3) and (..., 3, 1), summed in a
    fixed order: the last bit of numpy's result differs between processors."""
    terms = a[..., :, :, np.newaxis] * b[..., np.newaxis, :, :]
    summed: Matrix = (terms[..., 0, :] + terms[..., 1, :]) + terms[..., 2, :]
    return summed
