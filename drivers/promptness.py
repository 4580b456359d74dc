"""Promptness of answers: whether drives measured at the time of the request. Pure.

A request delayed by a busy machine or an adapter is answered late, at an unknown measurement time:
at 1 rad/s, a delay of 1 ms looks like 0.1 rad/s over a period of 10 ms. The usual delay and its
spread are tracked as medians, so that up to half of all answers may be late.
"""

import math
from typing import Final

#: An answer is late if it exceeds the usual delay by more than the larger of these: a share of the
#: period, and a multiple of the median absolute deviation.
_LATE_SHARE: Final = 0.15
_LATE_SPREADS: Final = 3.0
_FOLLOWS: Final = 0.001  # step of the medians per tick, as a share of the period


class Promptness:
    """Delay of the first answer of each tick, compared with the usual one."""

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
