"""Promptness of answers: whether drives measured when they were asked to. Pure.

A question that a busy machine, or an adapter, holds up is answered late, and what was measured is
of a moment that is not known: at 1 rad/s a millisecond looks like 0.1 rad/s over a period of 10 ms.
What is usual, and how far it varies, are followed as medians: half of all answers may be late.
"""

import math
from typing import Final

#: Of a period, and of the median deviation from what is usual: an answer that is later by more than
#: the larger of both is of an unknown moment.
_LATE_SHARE: Final = 0.15
_LATE_SPREADS: Final = 3.0
_FOLLOWS: Final = 0.001  # of a period, in a tick


class Promptness:
    """Delays of the first answer of each tick, and what is usual."""

    def __init__(self, period_s: float) -> None:
        self._least_s, self._step_s = _LATE_SHARE * period_s, _FOLLOWS * period_s
        self._usual_s, self._spread_s = math.nan, 0.0

    def step(self, delay_s: float) -> bool:
        """Take the delay of a tick's first answer [s]; True if it is no later than usual."""
        if math.isnan(self._usual_s):
            self._usual_s = delay_s
        late_s, most_s = delay_s - self._usual_s, max(self._least_s, _LATE_SPREADS * self._spread_s)
        self._usual_s += math.copysign(self._step_s, late_s)
        self._spread_s += math.copysign(self._step_s, abs(late_s) - self._spread_s)
        return late_s <= most_s
