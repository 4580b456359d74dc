"""Presence of the master on the bus: due time of the next heartbeat, and gaps that drives notice.

It counts from the last heartbeat that was really sent: a late wake-up, a suspension and a bus that
takes no frame are the same gap to a drive. After one, the drives may have stopped by themselves,
and would run on at the next SYNC: we are absent until all have confirmed that they are to stop.

Pure; time is an argument.
"""

import math


class Presence:
    """Presence with a SYNC every `period_s`, to drives of which the least patient waits for
    `patience_s`."""

    def __init__(self, patience_s: float, period_s: float) -> None:
        # Sent when the tick after this one would be too late for a third of the patience.
        self._beat_every_s = max(patience_s / 3.0 - period_s, 0.0)
        self._absence_s = patience_s - 0.5 * period_s
        self._beaten_s = -math.inf
        self.absent = False
        self.news = False
        """Absence has just begun: all drives are to be stopped."""

    def begin(self, now: float) -> None:
        """The drives hear us from now on."""
        self._beaten_s, self.absent = now, False

    def lost(self) -> None:
        """The drives may have heard nothing of us, or hear the past."""
        self.news = self.news or not self.absent
        self.absent = True

    def beaten(self, now: float) -> None:
        """A heartbeat has gone out."""
        self._beaten_s = now

    def beats(self, now: float) -> bool:
        """True if a heartbeat is due."""
        return now - self._beaten_s >= self._beat_every_s

    def gap_s(self, now: float) -> float | None:
        """Time for which nothing of ours was heard, if drives may have stopped for it and that is
        news; else None."""
        unheard_s = now - self._beaten_s
        return None if self.absent or unheard_s < self._absence_s else unheard_s
