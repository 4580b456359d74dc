"""Watch on the SDO servers of the drives: detects those that no longer answer while the arm stands.

A drive may send its PDOs and heartbeats, take its setpoints, and answer no SDO: then a stop by SDO
would not reach it. One question is on its way at a time, a frame, and its answer is read like any
other. Time is an argument.
"""

import struct
from collections.abc import Sequence
from typing import Final

from drivers.can.wire import Frame
from drivers.canopen.ids import SDO_REQUEST
from drivers.canopen.settings import CanopenDrive

#: From one look at all drives to the next [s].
ROUND_EVERY_S: Final = 5.0
#: Share of a drive's time-out that is waited here, as in a reset.
SHARE: Final = 0.3
#: Questions without an answer, one after the other, from which on a drive counts as silent.
UNANSWERED: Final = 2

# The error register (0x1001) is in every device by CiA 301, and no part of a stop.
_PLACE: Final = struct.pack("<HB", 0x1001, 0)
_QUESTION: Final = struct.pack("<B3s4x", 0x40, _PLACE)


class SdoWatch:
    """Watch of one arm: `ask` in every tick in which drives may be asked, `hear` their answers."""

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        self._nodes = [drive.node for drive in drives]
        self._patience_s = [SHARE * drive.profile.sdo_timeout_ms / 1000.0 for drive in drives]
        self._missed = [0] * len(drives)
        self._next = 0  # joint that is asked next, or is being asked; the last is past the end
        self._asked_s: float | None = None
        self._begun_s = 0.0  # of this round

    @property
    def silent(self) -> list[int]:
        """Joints whose drives do not answer."""
        return [i for i, missed in enumerate(self._missed) if missed >= UNANSWERED]

    def rest(self) -> None:
        """Ask no drive now, and drop a pending question. The next round begins when they are asked
        again."""
        self._asked_s, self._next = None, 0

    def forget(self) -> None:
        """All drives have just been read by SDO."""
        self._missed = [0] * len(self._missed)
        self.rest()

    def ask(self, now: float) -> list[Frame]:
        """The question of this tick, if there is one."""
        if self._asked_s is not None:
            if now - self._asked_s < self._patience_s[self._next]:
                return []
            self._missed[self._next] += 1
            self._next += self._missed[self._next] >= UNANSWERED
        if self._next == len(self._nodes):
            self._asked_s = None
            if now - self._begun_s < ROUND_EVERY_S:
                return []
            self._next = 0
        if self._next == 0:
            self._begun_s = now
        self._asked_s = now
        return [(SDO_REQUEST + self._nodes[self._next], _QUESTION)]

    def hear(self, node: int, data: bytes | bytearray) -> None:
        """Take a frame of a drive's SDO server; a refusal is an answer, too."""
        if data[1:4] != _PLACE or node not in self._nodes:
            return
        joint = self._nodes.index(node)
        self._missed[joint] = 0
        if joint == self._next and self._asked_s is not None:
            self._asked_s = None
            self._next += 1
