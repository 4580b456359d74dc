"""Steady pull: detection, within two seconds, of a contact that could be a load at the hand.

An arm that yields to a load hardly moves, so that it is recognised late, or never (`recognition`).
But a single pose already shows whether the residuals of all joints are a pull straight down at the
hand, and how many kg would pull so. That is no evidence of a load: a hand that rests on the arm
looks the same. It suffices for advice in case it is one, and for nothing else: nothing here changes
how the arm reacts.

Means are taken over a quarter of a second, at rest, too. Time is counted in ticks; no I/O.
"""

from typing import Final

import numpy as np

from common.arrays import Vector
from estimator.model import Model
from estimator.payload import HEAVIEST_KG
from estimator.recognition import fitted_load, weighed

_BLOCK_S: Final = 0.25
_BLOCKS: Final = 8  # consecutive blocks that must show the same mass
_LEAST_KG: Final = 0.1
# Share of the squared residuals that the fit may leave, and the least norm that it must explain.
_LEFT, _CLEAR = 0.2, 1.0
# Largest deviation of a block's mass from the median: share of it, or [kg].
_SPREAD, _SPREAD_KG = 0.2, 0.05
# Blocks for which a contact lasts after its detection: an arm that yields comes to rest exactly
# where its load is no longer detected.
_LASTS: Final = 10


class SteadyPull:
    """Steady pull on one arm; `mass` is the load that would pull so [kg], 0 without one."""

    def __init__(self, model: Model, period_s: float) -> None:
        self.mass = 0.0
        self._model = model
        self._ticks = round(_BLOCK_S / period_s)
        # Sums over the present block: q, |q_dot|, residual, threshold.
        self._sum = np.zeros((4, model.n))
        self._count, self._quiet = 0, _LASTS
        self._touched = False
        self._masses = np.full(_BLOCKS, np.nan)  # of the last blocks, the newest last

    @property
    def lasts(self) -> bool:
        """True while a contact is detected, or was until a moment ago."""
        return self._quiet < _LASTS

    def forget(self) -> None:
        """Forget the pull, because another contact begins."""
        self.mass, self._quiet = 0.0, _LASTS
        self._masses[:] = np.nan
        self.pause()

    def pause(self) -> None:
        """Discard the present block, in which something is unknown."""
        self._sum[:] = 0.0
        self._count, self._touched = 0, False

    def step(
        self, q: Vector, q_dot: Vector, residual: Vector, threshold: Vector, *, touched: bool
    ) -> None:
        """Process the estimate of one tick, (n,) each; touched: a residual is beyond its
        threshold."""
        self._touched = self._touched or touched
        total = self._sum
        total[0] += q
        total[1] += np.abs(q_dot)
        total[2] += residual
        total[3] += threshold
        self._count += 1
        if self._count >= self._ticks:
            self._end_block()

    def _end_block(self) -> None:
        mean, touched = self._sum / self._count, self._touched
        self.pause()
        self._quiet = 0 if touched else self._quiet + 1
        if self._quiet >= _LASTS:
            if self._quiet == _LASTS:
                self.forget()
            return
        self._masses[:-1] = self._masses[1:]
        self._masses[-1] = self._fitted(mean)
        self.mass = self._steady()

    def _fitted(self, mean: np.ndarray) -> float:
        """Mass of the pull that the means of a block (4, n) show [kg]; NaN without one."""
        x, _, y = weighed(self._model, mean, self._model.down)
        fitted = fitted_load(x, y)
        explained = x @ fitted
        left = y - explained
        is_pull = (
            _LEAST_KG < fitted[0] < HEAVIEST_KG
            and left @ left < _LEFT * (y @ y)
            and explained @ explained > _CLEAR**2
        )
        return float(fitted[0]) if is_pull else np.nan

    def _steady(self) -> float:
        """Median of the last masses if they agree, else 0 [kg]."""
        if np.isnan(self._masses).any():
            return 0.0
        median = float(np.median(self._masses))
        off = np.abs(self._masses - median).max()
        return median if off < max(_SPREAD * median, _SPREAD_KG) else 0.0
