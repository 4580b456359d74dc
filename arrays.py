"""Array types of the mathematics: one definition for the whole project."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""float64; shape (n,) unless stated otherwise: one entry per joint, SI at the link side."""

Matrix = NDArray[np.float64]
"""float64, shape (rows, n) or (n, n); rows are ticks or milliseconds, or as stated."""
