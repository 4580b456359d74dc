"""Learning of one joint with a configured contact level of 0.8 Nm."""

from typing import Any, Final

import numpy as np

from estimator.learning import Learning
from estimator.thresholds import Thresholds

DT, LEVEL = 0.01, 0.8
FOUND: Final = ("squares_s", "moved_s", "peak", "crossing_peak")
"""Fields from which the needed level is computed."""


def fresh(of: Any = Learning, load: float = 0.0, error: float = 0.0, **levels: Any) -> Any:
    """Learning before its first tick; `load`, `error`: friction per load, as identified."""
    stated = Thresholds(np.array([LEVEL]), np.array([6 * LEVEL]), **levels)
    return of(stated, np.array([load]), np.array([error]))


def teach(
    learning: Any, residual: float, level: float = LEVEL, moving: bool = True, **more: float
) -> None:
    """One tick of `more["dt"]`, by default DT [s]; `friction`, `raised` [Nm] and `doubt` are 0."""
    parts = (more.pop(name, 0.0) for name in ("friction", "raised", "doubt"))
    learning.learn(0, residual, level, LEVEL, *parts, False, moving, False, more.pop("dt", DT))
    assert not more


def found(learning: Any, names: tuple[str, ...] = FOUND) -> dict[str, float]:
    """State from which the needed level is computed."""
    return {name: float(getattr(learning.needed, name)[0]) for name in names}
