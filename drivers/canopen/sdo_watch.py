"""Watch on the SDO servers of the drives: detects those that no longer answer, while the arm is at
rest.

A drive may send PDOs and heartbeats and follow its setpoints, but answer no SDO: a stop by SDO
would not reach it. At most one request is pending; its answer is read like any frame. Time is an
argument.
"""

import struct
from collections.abc import Sequence
from typing import Final

from drivers.can.wire import Frame
from drivers.canopen.ids import SDO_REQUEST
from drivers.canopen.settings import CanopenDrive

#: Interval between rounds of requests to all drives [s].
ROUND_EVERY_S: Final = 5.0
#: Share of a drive's SDO timeout that applies here, as in a reset.
SHARE: Final = 0.3
#: Consecutive unanswered requests from which a drive counts as silent.
UNANSWERED: Final = 2

# The error register (0x1001) is mandatory in CiA 301, and not used by a stop.
_PLACE: Final = struct.pack("<HB", 0x1001, 0)
_QUESTION: Final = struct.pack("<B3s4x", 0x40, _PLACE)


class SdoWatch:
    """Watch of one arm: call `ask` in each tick that permits requests, and `on_sdo` for answers."""

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        self._nodes = [drive.node for drive in drives]
        self._timeout_s = [SHARE * drive.profile.sdo_timeout_ms / 1000.0 for drive in drives]
        self._missed = [0] * len(drives)
        self._next = 0  # joint of the next or pending request; past the end after a round
        self._asked_s: float | None = None
        self._begun_s = 0.0  # start of this round

    @property
    def silent(self) -> list[int]:
        """Joints whose drives do not answer."""
        return [i for i, missed in enumerate(self._missed) if missed >= UNANSWERED]

    def rest(self) -> None:
        """Drop a pending request, and begin a new round with the next `ask`."""
        self._asked_s, self._next = None, 0

    def forget(self) -> None:
        """Start over: all drives have just been read by SDO."""
        self._missed = [0] * len(self._missed)
        self.rest()

    def ask(self, now: float) -> list[Frame]:
        """Request of this tick, if one is due."""
        if self._asked_s is not None:
            if now - self._asked_s < self._timeout_s[self._next]:
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

    def on_sdo(self, node: int, data: bytes | bytearray) -> None:
        """Take a frame of a drive's SDO server; an abort counts as an answer, too."""
        if data[1:4] != _PLACE or node not in self._nodes:
            return
        joint = self._nodes.index(node)
        self._missed[joint] = 0
        if joint == self._next and self._asked_s is not None:
            self._asked_s = None
            self._next += 1
