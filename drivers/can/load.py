"""Worst-case bus load of the periodic frames, computed before the first one is sent."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from common.errors import ConfigurationError
from drivers.can.wire import EXTENDED

#: The rest is reserved for set-up, errors and retransmissions.
HIGHEST_LOAD: Final = 0.8


@dataclass(frozen=True, slots=True)
class FrameLoad:
    """One periodic frame on the bus."""

    name: str
    cob_id: int
    size: int  # bytes of data
    rate_hz: float
    every_tick: bool = True

    @property
    def bits(self) -> int:
        """Length on the wire with the worst-case stuff bits and the interframe space [bits]."""
        return frame_bits(self.size, extended=self.cob_id >= EXTENDED)


def frame_bits(size: int, *, extended: bool = False) -> int:
    """Worst-case bits of a data frame with `size` bytes and an 11-bit, or extended, identifier.

    44 bits of frame and 3 of interframe space surround the data; the first 34 of them and the data
    are subject to bit stuffing: one bit after the first five equal bits, then at worst after every
    four. An extended (29-bit) identifier adds 20 bits.
    """
    more = 20 if extended else 0
    stuffed = 34 + more + 8 * size
    return 47 + more + 8 * size + (stuffed - 1) // 4


def bus_load(frames: Sequence[FrameLoad], bitrate: int) -> float:
    """Worst-case bus load of these frames, as a fraction of the bitrate."""
    return sum(frame.bits * frame.rate_hz for frame in frames) / bitrate


def refuse_overload(frames: Sequence[FrameLoad], period_s: float, bitrate: int) -> None:
    """Raise ConfigurationError if the load of these frames exceeds `HIGHEST_LOAD`."""
    load = bus_load(frames, bitrate)
    if load > HIGHEST_LOAD:
        raise ConfigurationError(
            f"bus load {load:.0%} at {bitrate} bit/s and {1000 * period_s:g} ms; at most "
            f"{HIGHEST_LOAD:.0%} is allowed"
        )
