"""Trend of a figure: Theil-Sen's slope over the second half of a run.

The second half is cut into blocks, each of which counts with its median: neighbouring samples are
alike, and would make chance look certain. The slope is the median of those between all pairs of
blocks, so that a few bad moments of a busy machine are no trend, and a single step is none, either.
A trend is a growth over the second half that is beyond the tolerance *and* that chance does not
explain: its 95 % confidence interval lies above zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats


@dataclass(frozen=True, slots=True)
class Bound:
    """Growth that a figure may show over the second half of a run: a share of its median there, but
    at least `least`. More is a failure in runs from `binding_from_s` on: what goes up and down by
    itself takes its time, and what the machine may be to blame for is only reported."""

    unit: str
    share: float
    least: float
    binding_from_s: float = 0.0


BLOCKS = 12


@dataclass(frozen=True, slots=True)
class Trend:
    """A figure over the second half of a run, in the unit of its bound."""

    name: str
    unit: str
    median: float
    growth: float
    surely: float  # the lower end of the growth's confidence interval
    allowed: float
    binding: bool

    @property
    def grows(self) -> bool:
        """True where it grows beyond its bound and beyond chance."""
        return self.growth > self.allowed and self.surely > 0.0

    def data(self) -> dict[str, Any]:
        """The trend for JSON."""
        return {
            "unit": self.unit,
            "median": float(f"{self.median:.6g}"),
            "growth": float(f"{self.growth:.4g}"),
            "surely": float(f"{self.surely:.4g}"),
            "allowed": float(f"{self.allowed:.4g}"),
            "grows": self.grows,
        }


def second_half(times_s: Sequence[float]) -> slice:
    """The samples that are judged."""
    middle = (times_s[0] + times_s[-1]) / 2.0
    return slice(int(np.searchsorted(times_s, middle)), None)


def trend(name: str, bound: Bound, times_s: Sequence[float], values: Sequence[float]) -> Trend:
    """Trend of at least four samples in the second half. Raises ValueError if there are fewer."""
    late = second_half(times_s)
    t, y = np.asarray(times_s[late]), np.asarray(values[late], dtype=np.float64)
    if t.size < 4:
        raise ValueError(f"{t.size} samples of {name} in the second half: too few for a trend")
    blocks = min(BLOCKS, t.size)
    middles = [float(block.mean()) for block in np.array_split(t, blocks)]
    medians = [float(np.median(block)) for block in np.array_split(y, blocks)]
    slope, _, low, _ = stats.theilslopes(medians, middles, alpha=0.95)
    span, median = t[-1] - t[0], float(np.median(y))
    return Trend(
        name=name,
        unit=bound.unit,
        median=median,
        growth=float(slope * span),
        surely=float(low * span),
        allowed=max(bound.share * abs(median), bound.least),
        binding=times_s[-1] >= bound.binding_from_s,
    )
