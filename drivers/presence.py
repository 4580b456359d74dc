"""Presence of the master on the bus: due time of the next heartbeat, and gaps that drives notice.

Gaps count from the last heartbeat that was actually sent: a late wake-up, a suspended machine and a
bus that accepts no frame look the same to a drive. After a gap the drives may have stopped by
themselves, and would resume at the next SYNC; so the master counts as absent until all drives have
confirmed a stop command. Pure; time is an argument.
"""

import math


class Presence:
    """Presence with a SYNC every `period_s`, to drives whose shortest master timeout is
    `master_timeout_s`."""

    def __init__(self, master_timeout_s: float, period_s: float) -> None:
        # Due if the next tick would be later than a third of the timeout.
        self._beat_every_s = max(master_timeout_s / 3.0 - period_s, 0.0)
        self._absence_s = master_timeout_s - 0.5 * period_s
        self._beaten_s = -math.inf
        self.absent = False
        self.news = False
        """True if absence has just begun: all drives are to be stopped."""

    def begin(self, now: float) -> None:
        """Begin to be present: the drives receive our frames from now on."""
        self._beaten_s, self.absent = now, False

    def lost(self) -> None:
        """Count the master as absent: the drives may have received no frames, or outdated ones."""
        self.news = self.news or not self.absent
        self.absent = True

    def beaten(self, now: float) -> None:
        """Record that a heartbeat was sent."""
        self._beaten_s = now

    def beats(self, now: float) -> bool:
        """True if a heartbeat is due."""
        return now - self._beaten_s >= self._beat_every_s

    def gap_s(self, now: float) -> float | None:
        """Time since the last heartbeat [s] if drives may have stopped because of it and absence is
        not yet reported; else None."""
        unheard_s = now - self._beaten_s
        return None if self.absent or unheard_s < self._absence_s else unheard_s
