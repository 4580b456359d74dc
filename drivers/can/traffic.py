"""Bus load measured at run time, and the senders of unknown frames. Pure.

The load of the arm's own periodic frames is computed once; only other frames are counted. Time is
an argument.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from drivers.can.load import HIGHEST_LOAD, FrameLoad
from drivers.can.wire import EXTENDED, IDENTIFIER

#: Long enough to measure a rate, shorter than any drive's heartbeat timeout.
WINDOW_S: Final = 0.05
#: Lead in votes, as a share of the unknown frames, for an identifier to be named.
NAMED_SHARE: Final = 0.1

# Bits of a frame with interframe space but without stuff bits, which depend on the data: the
# reported load is a lower bound.
_FRAME_BITS, _EXTENDED_BITS = 47, 67


@dataclass(frozen=True, slots=True)
class BusLoaded:
    """Overload of the bus, by the arm's own frames and those of others."""

    load: float  # share of the bus, a lower bound
    unknown_hz: float  # rate of frames from unknown senders
    most: int | None  # their most frequent identifier, if one stands out

    @property
    def text(self) -> str:
        """Load and its senders as text."""
        unknown = f", {self.unknown_hz:.0f} unknown frames/s" if self.unknown_hz else ""
        most = "" if self.most is None else f", 0x{self.most:03X} among them"
        return f"bus load at least {self.load:.0%}{unknown}{most}".replace("%", " %")


class Traffic:
    """Counter of frames; `loaded` is the result of the last window."""

    def __init__(self, own: Sequence[FrameLoad], period_s: float, bitrate: int) -> None:
        """own: frames of the arm."""
        self._bitrate = bitrate
        self._window_s = WINDOW_S - 0.5 * period_s
        # Per second. Heartbeats are counted as they come.
        self._own_bits = sum(
            (_FRAME_BITS + 8 * frame.size) * frame.rate_hz for frame in own if frame.every_tick
        )
        # Typical size of an unawaited answer.
        self._answer_bits = _FRAME_BITS + 64
        self.begin(0.0, 0)

    def begin(self, now: float, late_frames: int) -> None:
        """Begin a window at `now`; late_frames: as in `step`."""
        self.loaded: BusLoaded | None = None
        """Load in the last window if it was too high, else None."""
        self._begun_s, self._late = now, late_frames
        self._bits = self._unknown = 0
        self._most, self._votes = 0, 0  # majority identifier (Boyer-Moore vote)

    def take(self, can_id: int, size: int, *, unknown: bool) -> None:
        """Count a frame that is not one of the arm's answers."""
        self._bits += (_EXTENDED_BITS if can_id & EXTENDED else _FRAME_BITS) + 8 * size
        if not unknown:
            return
        self._unknown += 1
        if can_id == self._most:
            self._votes += 1
        elif self._votes:
            self._votes -= 1
        else:
            self._most, self._votes = can_id, 1

    def step(self, now: float, late_frames: int) -> None:
        """Evaluate the window, once per tick; late_frames: total of unawaited answers so far."""
        passed_s = now - self._begun_s
        if passed_s < self._window_s:
            return
        bits = self._bits + (late_frames - self._late) * self._answer_bits
        load = (self._own_bits + bits / passed_s) / self._bitrate
        loaded = None
        if load > HIGHEST_LOAD:
            named = self._votes > NAMED_SHARE * self._unknown
            most = self._most & IDENTIFIER if named else None
            loaded = BusLoaded(min(load, 1.0), self._unknown / passed_s, most)
        self.begin(now, late_frames)
        self.loaded = loaded
