"""Traffic on the bus beside the arm's own frames: how loaded it is, and by whom. Pure.

The arm's own periodic frames are computed once; only the others are counted, as they come. Time is
an argument.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from drivers.can.load import HIGHEST_LOAD, FrameLoad
from drivers.can.wire import EXTENDED, IDENTIFIER

#: Long enough for a rate, shorter than any drive waits for our heartbeat.
WINDOW_S: Final = 0.05
#: Share of the unknown frames by which the identifier that is named outvotes the others.
NAMED_SHARE: Final = 0.1

# Bits of a frame and the gap to the next, without stuff bits, which depend on the data: the real
# load is at least the reported one.
_FRAME_BITS, _EXTENDED_BITS = 47, 67


@dataclass(frozen=True, slots=True)
class BusLoaded:
    """Too much of the bus is taken, by frames of others beside those of the arm."""

    load: float  # share of the bus, at least
    unknown_hz: float  # frames of unknown senders, per second
    most: int | None  # identifier of the most of these, if one stands out

    @property
    def text(self) -> str:
        """Load and its senders in words."""
        unknown = f", {self.unknown_hz:.0f} unknown frames/s" if self.unknown_hz else ""
        most = "" if self.most is None else f", 0x{self.most:03X} among them"
        return f"at least {self.load:.0%} of the bus is taken{unknown}{most}".replace("%", " %")


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
        # An answer that is not awaited, as a mean.
        self._answer_bits = _FRAME_BITS + 64
        self.begin(0.0, 0)

    def begin(self, now: float, late_frames: int) -> None:
        """Begin to count at `now`."""
        self.loaded: BusLoaded | None = None
        """The load, where it is too high."""
        self._begun_s, self._late = now, late_frames
        self._bits = self._unknown = 0
        self._most, self._votes = 0, 0  # a majority's identifier, if there is one (Boyer, Moore)

    def take(self, can_id: int, size: int, *, unknown: bool) -> None:
        """Count a frame that is none of the arm's answers."""
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
        """Once per tick; late_frames: answers until now that were not awaited."""
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
