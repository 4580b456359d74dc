"""Frames that come while drives are set up by SDO, kept for the tick after it.

An emergency, a boot-up message or another master's SYNC that comes while no tick runs is as valid
as any other. Answers to SDO are not kept, nor TPDOs: they are old by then.
"""

from typing import Final

from drivers.can.wire import Frame
from drivers.canopen.ids import NEXT_PDO, NODE, SDO_ANSWER, TPDO

#: Different frames; the same one again takes no more room.
MOST: Final = 512
_NOT_KEPT: Final = frozenset({SDO_ANSWER, *(TPDO + number * NEXT_PDO for number in range(4))})


class HeardFrames:
    """Buffer that keeps each frame once, in the order in which they came last, so that replaying
    them leads to the present state. Filled by the reader's thread; to be taken when that has ended.
    """

    def __init__(self) -> None:
        self._frames: dict[tuple[int, bytes], None] = {}

    def put(self, frame: Frame) -> None:
        """Keep a frame that came, if it is of a kind that is kept."""
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
        """Frames heard so far, which are then forgotten here."""
        frames: list[Frame] = list(self._frames)
        self._frames.clear()
        return frames
