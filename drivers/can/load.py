"""Load of the bus by periodic frames, at worst: computed before the first one is sent."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from common.errors import ConfigurationError
from drivers.can.wire import EXTENDED

#: Set-up, errors and repetitions need room, too.
HIGHEST_LOAD: Final = 0.8


@dataclass(frozen=True, slots=True)
class FrameLoad:
    """One kind of frame on the bus."""

    name: str
    cob_id: int
    size: int  # bytes of data
    rate_hz: float
    every_tick: bool = True

    @property
    def bits(self) -> int:
        """Length on the wire with the most stuff bits that can be, and the gap to the next."""
        return frame_bits(self.size, extended=self.cob_id >= EXTENDED)


def frame_bits(size: int, *, extended: bool = False) -> int:
    """Bits of a data frame with `size` bytes and an identifier of 11 bits, or 29, at worst.

    44 bits of frame and 3 of interframe space around the data; of these the first 34 and the data
    are stuffed: a bit after the first five equal ones, then at worst after every four. An extended
    identifier adds 20.
    """
    more = 20 if extended else 0
    stuffed = 34 + more + 8 * size
    return 47 + more + 8 * size + (stuffed - 1) // 4


def bus_load(frames: Sequence[FrameLoad], bitrate: int) -> float:
    """Fraction of the bus that these frames take at worst (1.0 is all of it)."""
    return sum(frame.bits * frame.rate_hz for frame in frames) / bitrate


def refuse_overload(frames: Sequence[FrameLoad], period_s: float, bitrate: int) -> None:
    """Raise ConfigurationError for frames that take more than `HIGHEST_LOAD`."""
    load = bus_load(frames, bitrate)
    if load > HIGHEST_LOAD:
        raise ConfigurationError(
            f"bus load {load:.0%} at {bitrate} bit/s and {1000 * period_s:g} ms; at most "
            f"{HIGHEST_LOAD:.0%} is allowed"
        )
