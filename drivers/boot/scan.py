"""Scan of a bus: who is there, by reading alone.

One SDO upload after the other, expedited, to every node id, and nothing else: no NMT, no SYNC, no
heartbeat, no write. It is refused where a master is heard, whose own SDO an answer to ours would
confuse, and ends where one begins meanwhile; neither can be told of a master that says nothing.
"""

import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Frame, Wire
from drivers.ids import HEARTBEAT, NMT, NODE, SDO_ANSWER, SDO_REQUEST, SYNC
from errors import BusError

NODES: Final = range(1, 128)
LISTEN_S: Final = 1.0
"""Long enough for any master's heartbeat or SYNC."""
ANSWER_S: Final = 0.5
"""That a drive may take to answer."""
AT_ONCE: Final = 8
"""Requests on their way: no adapter's queue is so short."""

DEVICE_TYPE: Final = (0x1000, 0)
VENDOR, PRODUCT, REVISION, SERIAL = ((0x1018, sub) for sub in (1, 2, 3, 4))
MODES: Final = (0x6502, 0)
ASKED: Final = (VENDOR, PRODUCT, REVISION, SERIAL, MODES)

_UPLOAD: Final = 0x40
_EXPEDITED: Final = 0x42
_NAMES: Final = {
    1: "pp",
    2: "vl",
    3: "pv",
    4: "tq",
    6: "hm",
    7: "ip",
    8: "csp",
    9: "csv",
    10: "cst",
}

Object = tuple[int, int]
"""Index and subindex."""


@dataclass(frozen=True, slots=True)
class FoundNode:
    """One node that answers; None where it does not have an object."""

    node: int
    device_type: int | None
    vendor: int | None
    product: int | None
    revision: int | None
    serial: int | None
    modes: int | None

    @property
    def is_drive(self) -> bool:
        """True for a drive by CiA 402."""
        return self.device_type is not None and self.device_type & 0xFFFF == 402

    @property
    def mode_names(self) -> str:
        """Modes that it supports (0x6502) by their short names: `pv hm csv`."""
        modes = self.modes or 0
        return " ".join(name for bit, name in _NAMES.items() if modes >> (bit - 1) & 1)


def scan(
    wire: Wire, *, nodes: Iterable[int] = NODES, listen_s: float = LISTEN_S,
    answer_s: float = ANSWER_S,
) -> list[FoundNode]:  # fmt: skip
    """Everybody who answers, by node id. Raises BusError where a master is heard, or the bus
    fails."""
    try:
        _refuse_master(wire, listen_s)
        here = _ask(wire, [(node, DEVICE_TYPE) for node in nodes], answer_s)
        answered = sorted({node for node, _ in here})
        more = _ask(wire, [(node, what) for node in answered for what in ASKED], answer_s)
    except BUS_FAILURES as error:
        raise BusError(f"the bus cannot be scanned: {error}") from error
    values = here | more
    return [
        FoundNode(node, *(values.get((node, what)) for what in (DEVICE_TYPE, *ASKED)))
        for node in answered
    ]


def _refuse_master(wire: Wire, listen_s: float) -> None:
    deadline = time.monotonic() + listen_s
    drives: set[int] = set()
    while (left := deadline - time.monotonic()) > 0.0:
        frame = wire.receive(left)
        if frame is None:
            continue
        can_id, _ = frame
        for what, heard in (
            ("sends SYNC", can_id == SYNC),
            ("sends NMT commands", can_id == NMT),
            (f"asks node {can_id & NODE} by SDO", can_id & ~NODE == SDO_REQUEST),
        ):
            if heard:
                raise BusError(
                    f"a master is on this bus: somebody {what}. End it first (`contactd run` is "
                    "one): two masters confuse each other's drives"
                )
        if can_id & ~NODE == HEARTBEAT:
            drives.add(can_id & NODE)
    # Drives send no heartbeat before a master has told them to, and a master is none.
    for node in sorted(drives):
        if not _ask(wire, [(node, DEVICE_TYPE)], ANSWER_S):
            raise BusError(
                f"a master is on this bus: node {node} sends heartbeats and answers no SDO"
            )


def _ask(
    wire: Wire, requests: list[tuple[int, Object]], answer_s: float
) -> dict[tuple[int, Object], int | None]:
    """Answers by (node, object); None to what was refused, nothing where nobody answered. One
    request to a node at a time, as SDO wants it."""
    left, found = list(requests), dict[tuple[int, Object], int | None]()
    waiting: dict[int, tuple[Object, float]] = {}
    while left or waiting:
        for node, what in list(left):
            if len(waiting) >= AT_ONCE:
                break
            if node not in waiting:
                wire.send([(SDO_REQUEST + node, struct.pack("<BHB4x", _UPLOAD, *what))])
                waiting[node] = what, time.monotonic() + answer_s
                left.remove((node, what))
        frame = wire.receive(0.005)
        if frame is not None:
            if frame[0] in (SYNC, NMT):
                raise BusError("a master began while the bus was asked: end it first")
            _hear(frame, waiting, found)
        now = time.monotonic()
        waiting = {node: one for node, one in waiting.items() if one[1] > now}
    return found


def _hear(
    frame: Frame,
    waiting: dict[int, tuple[Object, float]],
    found: dict[tuple[int, Object], int | None],
) -> None:
    can_id, data = frame
    node = can_id & NODE
    if can_id & ~NODE != SDO_ANSWER or node not in waiting or len(data) != 8:
        return
    command, index, subindex, value = struct.unpack("<BHBI", data)
    what, _ = waiting[node]
    if (index, subindex) != what:
        return
    # The sizes that are not said are four bytes; an abort and a longer answer have no value.
    unused = command >> 2 & 3 if command & 1 else 0
    expedited = command & 0xE2 == _EXPEDITED
    found[node, what] = value & 0xFFFFFFFF >> 8 * unused if expedited else None
    del waiting[node]
