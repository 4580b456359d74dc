"""Load of the bus by an arm, at worst: computed before the first frame is sent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from common.errors import ConfigurationError
from drivers.canopen.codec import receive_pdos, transmit_pdos
from drivers.canopen.drive import Drive
from drivers.canopen.ids import HEARTBEAT, SYNC

#: SDO, emergencies and repetitions need room, too.
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
        return frame_bits(self.size)


def frame_bits(size: int) -> int:
    """Bits of a data frame with an 11-bit identifier and `size` bytes, at worst.

    44 bits of frame and 3 of interframe space around the data; of these the first 34 and the data
    are stuffed: a bit after the first five equal ones, then at worst after every four.
    """
    stuffed = 34 + 8 * size
    return 47 + 8 * size + (stuffed - 1) // 4


def frame_table(
    drives: Sequence[Drive], period_s: float, master_node: int = 127
) -> tuple[FrameLoad, ...]:
    """Every periodic frame of the arm."""
    tick_hz = 1.0 / period_s
    # The master beats on a tick, at least three times within the shortest patience of a drive.
    patience_s = min(drive.profile.master_timeout_ms for drive in drives) / 1000.0
    beat_s = period_s * max(1, math.floor(patience_s / 3.0 / period_s))
    table = [
        FrameLoad("SYNC", SYNC, 0, tick_hz),
        FrameLoad("heartbeat of the master", HEARTBEAT + master_node, 1, 1.0 / beat_s, False),
    ]
    for drive in drives:
        for kind, pdos in (("TPDO", transmit_pdos(drive)), ("RPDO", receive_pdos(drive))):
            table += [
                FrameLoad(f"{drive.name} {kind}{pdo.number}", pdo.cob_id, pdo.layout.size, tick_hz)
                for pdo in pdos
            ]
        beat_hz = 1000.0 / drive.profile.heartbeat_ms
        table.append(
            FrameLoad(f"{drive.name} heartbeat", HEARTBEAT + drive.node, 1, beat_hz, False)
        )
    return tuple(table)


def frame_rate_hz(drives: Sequence[Drive], period_s: float) -> float:
    """Periodic frames of the arm per second, in both directions."""
    return sum(frame.rate_hz for frame in frame_table(drives, period_s))


def bus_load(drives: Sequence[Drive], period_s: float, bitrate: int) -> float:
    """Fraction of the bus that the arm's periodic frames take at worst (1.0 is all of it)."""
    table = frame_table(drives, period_s)
    return sum(frame.bits * frame.rate_hz for frame in table) / bitrate


def refuse_overload(drives: Sequence[Drive], period_s: float, bitrate: int) -> float:
    """The load; raises ConfigurationError above `HIGHEST_LOAD`."""
    load = bus_load(drives, period_s, bitrate)
    if load > HIGHEST_LOAD:
        raise ConfigurationError(
            f"bus load {load:.0%} at {bitrate} bit/s and {1000 * period_s:g} ms; at most "
            f"{HIGHEST_LOAD:.0%} is allowed"
        )
    return load
