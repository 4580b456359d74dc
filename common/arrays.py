"""Array types of the mathematics: one definition for the whole project; and the checks of arguments
that compiled loops need."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""float64; shape (n,) unless stated otherwise: one entry per joint, SI at the link side."""

Matrix = NDArray[np.float64]
"""float64, shape (rows, n) or (n, n); rows are ticks or milliseconds, or as stated."""


def check_shapes(shape: Sequence[int], **given: Any) -> None:
    """Raise ValueError for an array of another shape: a compiled loop would read, or write, beyond
    its end."""
    for name, value in given.items():
        if getattr(value, "shape", None) != shape:
            found = getattr(value, "shape", type(value).__name__)
            raise ValueError(f"{name} is {found}; it must be an array of shape {shape}")


def product(a: Matrix, b: Matrix) -> Matrix:
    """Products a @ b of matrices (..., 3, 3), or of those and vectors (..., 3, 1), as sums in one
    order: those of numpy differ in their last bit between processors."""
    terms = a[..., :, :, np.newaxis] * b[..., np.newaxis, :, :]
    summed: Matrix = (terms[..., 0, :] + terms[..., 1, :]) + terms[..., 2, :]
    return summed
