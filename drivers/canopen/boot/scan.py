"""Scan of a bus for nodes, read-only.

It sends expedited SDO uploads to every node ID and nothing else: no NMT, no SYNC, no heartbeat, no
write. It is refused if a master is heard, whose own SDO transfers our answers would disturb, and
aborted if one starts meanwhile; a master that sends nothing is not detected.
"""

import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from common.errors import BusError
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Frame, Wire
from drivers.canopen.ids import HEARTBEAT, NMT, NODE, SDO_ANSWER, SDO_REQUEST, SYNC

NODES: Final = range(1, 128)
LISTEN_S: Final = 1.0
"""Long enough for any master's heartbeat or SYNC."""
ANSWER_S: Final = 0.5
"""Answer timeout of a drive."""
TWICE: Final = 2
"""Number of repeated answers from which a node counts as two drives."""
AT_ONCE: Final = 8
"""Maximum number of pending requests: the queue of any adapter holds more."""

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
    """One node that answers; None for objects that it lacks."""

    node: int
    device_type: int | None
    vendor: int | None
    product: int | None
    revision: int | None
    serial: int | None
    modes: int | None
    twice: bool = False
    """Two nodes answer under this node ID."""

    @property
    def is_drive(self) -> bool:
        """True for a CiA 402 drive."""
        return self.device_type is not None and self.device_type & 0xFFFF == 402

    @property
    def mode_names(self) -> str:
        """Supported modes (0x6502) by their abbreviations: `pv hm csv`."""
        modes = self.modes or 0
        return " ".join(name for bit, name in _NAMES.items() if modes >> (bit - 1) & 1)


def scan(
    wire: Wire, *, nodes: Iterable[int] = NODES, listen_s: float = LISTEN_S,
    answer_s: float = ANSWER_S,
) -> list[FoundNode]:  # fmt: skip
    """Nodes that answer, by node ID. Raises BusError if a master is heard or the bus fails."""
    try:
        _refuse_master(wire, listen_s)
        again: list[int] = []
        here = _ask(wire, [(node, DEVICE_TYPE) for node in nodes], answer_s, again)
        answered = sorted({node for node, _ in here})
        asked = [(node, what) for node in answered for what in ASKED]
        more = _ask(wire, asked, answer_s, again)
    except BUS_FAILURES as error:
        raise BusError(f"the bus cannot be scanned: {error}") from error
    values = here | more
    return [
        FoundNode(node, *_identity(values, node), again.count(node) >= TWICE) for node in answered
    ]


def _identity(
    values: dict[tuple[int, Object], int | None], node: int
) -> tuple[int | None, int | None, int | None, int | None, int | None, int | None]:
    device_type, vendor, product = (values.get((node, at)) for at in (DEVICE_TYPE, VENDOR, PRODUCT))
    revision, serial, modes = (values.get((node, at)) for at in (REVISION, SERIAL, MODES))
    return device_type, vendor, product, revision, serial, modes


def _refuse_master(wire: Wire, listen_s: float) -> None:
    deadline = time.monotonic() + listen_s
    drives: set[int] = set()
    while (left := deadline - time.monotonic()) > 0.0:
        frame = wire.receive(left)
        if frame is None:
            continue
        can_id, _ = frame
        for what, received in (
            ("SYNC", can_id == SYNC),
            ("NMT commands", can_id == NMT),
            (f"SDO requests to node {can_id & NODE}", can_id & ~NODE == SDO_REQUEST),
        ):
            if received:
                raise BusError(
                    f"a master is on this bus: it sends {what}. Stop it first (`contactd run` is "
                    "one): two masters interfere with each other"
                )
        if can_id & ~NODE == HEARTBEAT:
            drives.add(can_id & NODE)
    # Drives send no heartbeat until a master configures it, and a master answers no SDO.
    for node in sorted(drives):
        if not _ask(wire, [(node, DEVICE_TYPE)], ANSWER_S, []):
            raise BusError(
                f"a master is on this bus: node {node} sends heartbeats but answers no SDO"
            )


def _ask(
    wire: Wire, requests: list[tuple[int, Object]], answer_s: float, again: list[int]
) -> dict[tuple[int, Object], int | None]:
    """Answers by (node, object): None if refused, no entry without an answer. At most one request
    per node is pending, as SDO requires. Each repeated answer appends its node to `again`."""
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
                raise BusError("a master started during the scan: stop it first")
            _hear(frame, waiting, found, again)
        now = time.monotonic()
        waiting = {node: one for node, one in waiting.items() if one[1] > now}
    return found


def _hear(
    frame: Frame,
    waiting: dict[int, tuple[Object, float]],
    found: dict[tuple[int, Object], int | None],
    again: list[int],
) -> None:
    can_id, data = frame
    node = can_id & NODE
    if can_id & ~NODE != SDO_ANSWER or len(data) != 8:
        return
    command, index, subindex, value = struct.unpack("<BHBI", data)
    what = index, subindex
    if (node, what) in found:
        again.append(node)
        return
    if node not in waiting or waiting[node][0] != what:
        return
    # An unstated size is four bytes; an abort and a longer answer have no value.
    unused = command >> 2 & 3 if command & 1 else 0
    expedited = command & 0xE2 == _EXPEDITED
    found[node, what] = value & 0xFFFFFFFF >> 8 * unused if expedited else None
    del waiting[node]
