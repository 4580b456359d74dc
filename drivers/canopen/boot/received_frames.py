"""Frames received while drives are set up by SDO, kept for the next tick.

An emergency, a boot-up message or another master's SYNC counts even if no tick runs when it
arrives. SDO answers and TPDOs are not kept: they would be outdated.
"""

from typing import Final

from drivers.can.wire import Frame
from drivers.canopen.ids import NEXT_PDO, NODE, SDO_ANSWER, TPDO

#: Bound on distinct frames; repeated ones are stored once.
MOST: Final = 512
_NOT_KEPT: Final = frozenset({SDO_ANSWER, *(TPDO + number * NEXT_PDO for number in range(4))})


class ReceivedFrames:
    """Buffer that keeps each distinct frame once, in the order of last arrival, so that replaying
    them yields the present state. Filled by the reader thread; read it once that has ended."""

    def __init__(self) -> None:
        self._frames: dict[tuple[int, bytes], None] = {}

    def put(self, frame: Frame) -> None:
        """Store a received frame unless it is an SDO answer or a TPDO."""
        can_id, data = frame
        if can_id & ~NODE in _NOT_KEPT:
            return
        key = can_id, bytes(data)
        known = key in self._frames
        if not known and len(self._frames) >= MOST:
            return
        if known:
            del self._frames[key]
        self._frames[key] = None

    def take(self) -> list[Frame]:
        """Return the frames received so far, and clear the buffer."""
        frames: list[Frame] = list(self._frames)
        self._frames.clear()
        return frames
