"""Quiet timer: time for which the thresholded residual has been zero on all joints. Pure; time is
an argument.

When it expires, an arm that yielded to a contact continues the trajectory that was interrupted.
Time in which a touch might not be detected does not count as quiet.
"""

from dataclasses import dataclass

# Tolerance for the rounding of a sum of periods [s].
ROUNDING_S = 5e-4


@dataclass(slots=True)
class QuietTimer:
    """Timer that runs from the last tick with a touch, or from `restart`; it pauses while sensing
    is not reliable."""

    limit_s: float
    quiet_s: float = 0.0
    """Quiet time as of the last `sense` [s]"""
    _touched_s: float = 0.0
    _sensed_s: float = 0.0

    def sense(self, touched: bool, time_s: float, *, sure: bool = True) -> None:
        """Process one tick: `touched` if any thresholded residual is not zero."""
        if touched:
            self._touched_s = time_s
        elif not sure:
            self._touched_s += time_s - self._sensed_s
        self._sensed_s = time_s
        self.quiet_s = time_s - self._touched_s

    def restart(self, time_s: float) -> None:
        """Start again from `time_s`."""
        self._touched_s = self._sensed_s = time_s
        self.quiet_s = 0.0

    @property
    def expired(self) -> bool:
        """True once it has been quiet for the limit."""
        return self.quiet_s >= self.limit_s - ROUNDING_S
