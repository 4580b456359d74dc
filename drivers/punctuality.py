"""Punctuality of TPDOs: the SYNC that each one answers, inferred from counts alone. Pure.

A TPDO does not identify the SYNC that it answers. One that is always a period late arrives once per
SYNC, like any other, but its contents are a period old. Such a delay begins with a SYNC that got no
answer in time; so does the loss of a frame. Skipping one SYNC separates the two: only late answers
arrive then. Two drives with the same node ID answer every SYNC twice.

TPDOs are bits of an integer. Time is an argument.
"""

import math
from typing import Final

#: Time from a missing answer to the SYNC that is skipped because of it [ticks].
DOUBT_TICKS: Final = 5
#: Shortest time between two skipped SYNCs [s]: on a bus that loses frames a tick without answers
#: must be rare, as two more missing beside it stop the arm. While answers are known to be old, the
#: arm holds anyway.
LEFT_OUT_EVERY_S, LEFT_OUT_EVERY_WHILE_OLD_S = 10.0, 1.0
#: Consecutive SYNCs that a TPDO has to answer twice.
TWICE_TICKS: Final = 5


class Punctuality:
    """Comparison of SYNCs with answers; `old` and `twice` are the results."""

    def __init__(self, period_s: float) -> None:
        self._doubt_s = (DOUBT_TICKS - 0.5) * period_s
        self.start_anew()

    def start_anew(self) -> None:
        """Start over after a pause without SYNC."""
        self.old = 0
        """TPDOs that were a period late when last checked."""
        self.twice = 0
        """TPDOs that two drives send."""
        self._unanswered = 0  # TPDOs missing after the last SYNC
        self._doubts = 0  # TPDOs missing after some earlier SYNC
        self._doubted_s = self._probed_s = -math.inf
        self._probing = False
        self._seen = 0  # TPDOs received while a SYNC is skipped
        self._extra = self._more = 0  # TPDOs received a second, a third time since the last SYNC
        self._suspects = self._twice_ticks = 0

    def unawaited(self, bit: int) -> bool:
        """Record an unawaited TPDO; True if it shows that an earlier answer was old."""
        if self._unanswered & bit:
            self._unanswered ^= bit  # late, but before the next SYNC
        elif self._doubts & bit:
            self._doubts ^= bit
            self._seen |= bit
            return not self._probing
        else:
            self._more |= self._extra & bit
            self._extra |= bit
        return False

    def ended(self, missing: int) -> None:
        """End a tick with a SYNC; `missing`: TPDOs that did not arrive."""
        self._unanswered = missing

    def doubted(self, now: float) -> int:
        """TPDOs that will soon be checked by skipping a SYNC."""
        return self._doubts if self._doubts and self._may_probe(now) else 0

    def _may_probe(self, now: float) -> bool:
        every_s = LEFT_OUT_EVERY_WHILE_OLD_S if self.old else LEFT_OUT_EVERY_S
        return now - self._probed_s >= every_s

    def leaves_out(self, now: float) -> bool:
        """True if the SYNC of this tick is to be skipped, to check for old answers."""
        if not self._doubts or self._unanswered or now - self._doubted_s < self._doubt_s:
            return False
        if not self._may_probe(now):
            return False
        self._probing, self._probed_s, self._seen = True, now, 0
        return True

    def asked(self, now: float) -> None:
        """Begin a SYNC, which is about to be sent; all frames received before it are processed."""
        if self._probing:
            self._probing = False
            self.old = self._seen
            self._doubts = 0
        if doubts := self._unanswered | self.old:
            if not self._doubts:
                self._doubted_s = now
            self._doubts |= doubts
            self._unanswered = 0
        if self._extra or self._twice_ticks:
            self._compare()

    def _compare(self) -> None:
        twice = self._extra & ~self._more
        same = twice & self._suspects
        self._twice_ticks = self._twice_ticks + 1 if same else int(twice > 0)
        self._suspects = same or twice
        self.twice = self._suspects if self._twice_ticks >= TWICE_TICKS else 0
        self._extra = self._more = 0
