"""Punctuality of TPDOs: the SYNC that each one answers, from their numbers alone. Pure.

A TPDO does not name the SYNC that it answers. One that is a period late for ever comes once every
SYNC, like any other, and its contents are a period old. It began with a SYNC that got no answer
in time; so does every frame that is lost. Which of the two it was shows where a SYNC is left out:
only old answers come then. Two drives with one node number answer every SYNC twice.

TPDOs are bits of an integer. Time is an argument.
"""

import math
from typing import Final

#: From a missing answer to the SYNC that is left out for it [ticks].
DOUBT_TICKS: Final = 5
#: Between two of these [s]: on a bus that loses frames a tick without answers must be rare, as two
#: more that are missing beside it stop the arm; and where answers are known to be old it holds.
LEFT_OUT_EVERY_S, LEFT_OUT_EVERY_WHILE_OLD_S = 10.0, 1.0
#: So many SYNCs in a row that a TPDO answers twice.
TWICE_TICKS: Final = 5


class Punctuality:
    """Count of SYNCs against answers; `old` and `twice` are the results."""

    def __init__(self, period_s: float) -> None:
        self._patience_s = (DOUBT_TICKS - 0.5) * period_s
        self.start_anew()

    def start_anew(self) -> None:
        """No SYNC has gone out for some time."""
        self.old = 0
        """TPDOs that were a period late when last looked at."""
        self.twice = 0
        """TPDOs that two drives send."""
        self._unanswered = 0  # of the last SYNC
        self._doubts = 0  # did not answer some SYNC before that
        self._doubted_s = self._probed_s = -math.inf
        self._probing = False
        self._seen = 0  # while a SYNC is left out
        self._extra = self._more = 0  # since the last SYNC: beyond its answer, beyond two
        self._suspects = self._twice_ticks = 0

    def unawaited(self, bit: int) -> bool:
        """Take a TPDO that is not awaited; True if an answer before it was old."""
        if self._unanswered & bit:
            self._unanswered ^= bit  # late, before the next SYNC: its own
        elif self._doubts & bit:
            self._doubts ^= bit
            self._seen |= bit
            return not self._probing
        else:
            self._more |= self._extra & bit
            self._extra |= bit
        return False

    def ended(self, missing: int) -> None:
        """A tick with a SYNC ends without these answers."""
        self._unanswered = missing

    def doubted(self, now: float) -> int:
        """TPDOs of which it will soon be seen whether they are old."""
        return self._doubts if self._doubts and self._may_look(now) else 0

    def _may_look(self, now: float) -> bool:
        every_s = LEFT_OUT_EVERY_WHILE_OLD_S if self.old else LEFT_OUT_EVERY_S
        return now - self._probed_s >= every_s

    def leaves_out(self, now: float) -> bool:
        """True if the SYNC of this tick is to be left out, to see whether old answers come."""
        if not self._doubts or self._unanswered or now - self._doubted_s < self._patience_s:
            return False
        if not self._may_look(now):
            return False
        self._probing, self._probed_s, self._seen = True, now, 0
        return True

    def asked(self, now: float) -> None:
        """SYNC is about to go out; all that came before is taken."""
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
