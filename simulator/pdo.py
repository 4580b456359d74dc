"""Process data objects of one drive: mapping as in CiA 301, packing, triggers."""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from simulator.emergency import COMMUNICATION_ERROR, PDO_TOO_LONG, PDO_TOO_SHORT, Emergencies
from simulator.objects import Objects, key
from simulator.surroundings import Send

INVALID = 1 << 31
SYNCHRONOUS = 240
"""Highest synchronous transmission type; 254 and 255 are event-driven."""

Apply = Callable[[tuple[int, ...], tuple[int, ...]], None]
"""(keys, values): writes the contents of an RPDO."""


@dataclass(frozen=True, slots=True)
class Mapping:
    """Objects of a PDO, in order, and the layout that packs them."""

    keys: tuple[int, ...]
    layout: struct.Struct


def mapping(objects: Objects, index: int) -> Mapping:
    """Mapping presently in object 16xx or 1Axx (`index`)."""
    count = objects.number(index, 0)
    keys = tuple(objects.number(index, sub) >> 8 for sub in range(1, count + 1))
    return Mapping(keys, struct.Struct("<" + "".join(objects.entries[k].code for k in keys)))


def pdo_numbers(objects: Objects, communication: int) -> list[int]:
    """Numbers of the drive's PDOs, from 0; communication: 0x1400 or 0x1800."""
    return [n for n in range(0x200) if key(communication + n, 1) in objects.entries]


class ReceivePdo:
    """One RPDO: latched until the SYNC, or applied at once."""

    def __init__(self, objects: Objects, number: int, apply: Apply) -> None:
        self._objects, self.number, self._apply = objects, number, apply
        self._pending: bytes | None = None
        self.reload()

    def reload(self) -> None:
        """Read the configuration from 14xx and 16xx."""
        cob = self._objects.number(0x1400 + self.number, 1)
        self.cob_id = -1 if cob & INVALID else cob & 0x7FF
        self._waits = self._objects.number(0x1400 + self.number, 2) <= SYNCHRONOUS
        self._mapping = mapping(self._objects, 0x1600 + self.number)
        self._pending = None

    @property
    def length(self) -> int:
        """Length of the mapped data [bytes]."""
        return self._mapping.layout.size

    def receive(self, data: bytes) -> None:
        """Take a frame that is long enough; it is applied now or at the SYNC."""
        self._pending = data
        if not self._waits:
            self.latch()

    def latch(self) -> None:
        """Apply the frame received since the last SYNC, if any."""
        if self._pending is not None:
            layout, data = self._mapping.layout, self._pending
            self._pending = None
            self._apply(self._mapping.keys, layout.unpack_from(data))


class TransmitPdo:
    """One TPDO: on every n-th SYNC, or on change and by its event timer."""

    def __init__(self, objects: Objects, number: int) -> None:
        self._objects, self.number = objects, number
        self.reload()

    def reload(self) -> None:
        """Read the configuration from 18xx and 1Axx."""
        objects, index = self._objects, 0x1800 + self.number
        cob = objects.number(index, 1)
        self.cob_id = -1 if cob & INVALID else cob & 0x7FF
        self._type = objects.number(index, 2)
        self._inhibit_s = 1e-4 * objects.number(index, 3)
        self._event_s = 1e-3 * objects.number(index, 5)
        self._mapping = mapping(objects, 0x1A00 + self.number)
        self._syncs = 0
        self._last: bytes | None = None
        self._sent_at = float("-inf")

    @property
    def by_event(self) -> bool:
        """True if it is event-driven."""
        return self.cob_id >= 0 and self._type > SYNCHRONOUS

    def pack(self) -> bytes:
        """Packed present values of the mapped objects."""
        values = self._objects.values
        return self._mapping.layout.pack(*map(values.__getitem__, self._mapping.keys))

    def on_sync(self) -> bytes | None:
        """Data to send at this SYNC, or None: type 0 on change, type n at every n-th SYNC."""
        if self.cob_id < 0 or self._type > SYNCHRONOUS:
            return None
        self._syncs += 1
        if self._type == 0:
            data = self.pack()
            changed, self._last = data != self._last, data
            return data if changed else None
        if self._syncs < self._type:
            return None
        self._syncs = 0
        return self.pack()

    def on_time(self, now: float) -> bytes | None:
        """Data to send because of a change or the event timer, or None."""
        waited = now - self._sent_at
        if waited < self._inhibit_s:
            return None
        data = self.pack()
        if data == self._last and not (self._event_s and waited >= self._event_s):
            return None
        self._last, self._sent_at = data, now
        return data


class Pdos:
    """All PDOs of one drive; a frame of wrong length raises an error."""

    def __init__(self, objects: Objects, errors: Emergencies, apply: Apply, send: Send) -> None:
        self.received = [ReceivePdo(objects, n, apply) for n in pdo_numbers(objects, 0x1400)]
        self.sent = [TransmitPdo(objects, n) for n in pdo_numbers(objects, 0x1800)]
        self._send, self._errors = send, errors

    def reload(self, number: int | None = None) -> None:
        """Read the configuration of all PDOs, or of those with one number."""
        every: list[ReceivePdo | TransmitPdo] = [*self.received, *self.sent]
        for pdo in every:
            if number in (None, pdo.number):
                pdo.reload()

    def listens(self, cob_id: int) -> bool:
        """True if one of the RPDOs is presently configured to this identifier."""
        return any(pdo.cob_id == cob_id for pdo in self.received)

    def receive(self, cob_id: int, data: bytes, *, minds_longer: bool) -> None:
        """Take a frame that may be one of the RPDOs."""
        for pdo in self.received:
            if pdo.cob_id == cob_id:
                if len(data) < pdo.length:
                    self._errors.raise_error(PDO_TOO_SHORT, COMMUNICATION_ERROR)
                elif len(data) > pdo.length and minds_longer:
                    self._errors.raise_error(PDO_TOO_LONG, COMMUNICATION_ERROR)
                else:
                    pdo.receive(data)

    def latch(self) -> None:
        """Apply, at a SYNC, the RPDOs received since the last one."""
        for pdo in self.received:
            pdo.latch()

    def transmit(self) -> None:
        """Send the synchronous TPDOs at a SYNC."""
        for pdo in self.sent:
            if (data := pdo.on_sync()) is not None:
                self._send(pdo.cob_id, data)

    def transmit_due(self, now: float) -> None:
        """Send the event-driven TPDOs that are due."""
        for pdo in self.sent:
            if pdo.by_event and (data := pdo.on_time(now)) is not None:
                self._send(pdo.cob_id, data)


def pdo_number(where: int) -> int | None:
    """Number (0 to 3) of the PDO that the object with this key configures, if any."""
    index = where >> 8
    for base in (0x1400, 0x1600, 0x1800, 0x1A00):
        if base <= index < base + 0x200:
            return index - base
    return None
