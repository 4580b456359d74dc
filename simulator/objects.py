"""Object dictionary of one drive: values, access rights and limits as declared in its EDS."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from canopen.sdo.exceptions import SdoAbortedError

from common.eds import EdsObject, read_eds
from simulator.supplied import supplied

NO_OBJECT = 0x06020000
NO_SUBINDEX = 0x06090011
WRITE_ONLY = 0x06010001
READ_ONLY = 0x06010002
UNSUPPORTED_ACCESS = 0x06010000
LENGTH_MISMATCH = 0x06070010
INVALID_VALUE = 0x06090030
TOO_HIGH = 0x06090031
TOO_LOW = 0x06090032
NOT_MAPPABLE = 0x06040041
PDO_TOO_LONG = 0x06040042

FORMATS = {2: "b", 3: "h", 4: "i", 5: "B", 6: "H", 7: "I"}
"""Struct codes by CANopen data type: INTEGER8 to UNSIGNED32."""
SPANS = {
    code: (0, 256**size - 1) if code.isupper() else (-(256**size) // 2, 256**size // 2 - 1)
    for code in FORMATS.values()
    for size in (struct.calcsize("<" + code),)
}
"""Lowest and highest value by struct code."""

HEARTBEATS = 0x1016
Value = int | bytes
Guard = Callable[[int, int], None]
"""(subindex, value): raises SdoAbortedError to refuse a write."""


def key(index: int, subindex: int = 0) -> int:
    """Single number that combines index and subindex of an object."""
    return index << 8 | subindex


@dataclass(frozen=True, slots=True)
class Entry:
    """One variable of the EDS. `code` is its struct format, "" for a string."""

    code: str
    readable: bool
    writable: bool
    mappable: bool
    low: int | None
    high: int | None
    default: Value


class Objects:
    """Values by `key(index, subindex)`; `read` and `write` follow the rules of SDO."""

    def __init__(self, eds: Path, node: int) -> None:
        """Raises ConfigurationError if the EDS is missing or unreadable."""
        self.entries = dict(entries(eds, node))
        self._indices = {k >> 8 for k in self.entries}
        self._spans = {k: SPANS[entry.code] for k, entry in self.entries.items() if entry.code}
        self.values: dict[int, Value] = {k: entry.default for k, entry in self.entries.items()}
        self.guards: dict[int, Guard] = {}
        """Guards by index, called before a value is stored."""
        self.written: Callable[[int], None] = lambda _: None
        """Function called with the key after a value is stored."""

    def set_default(self, where: int, value: int) -> None:
        """Set a default of the individual device, e.g. the serial number; no effect if the EDS
        lacks the object."""
        old = self.entries.get(where)
        if old is None:
            return
        self.entries[where] = replace(old, default=value)
        self.values[where] = value

    def show(self, where: int, value: int) -> None:
        """Set a value from inside the drive, if it has the object."""
        if where in self.values:
            self.values[where] = value

    def hold(self, where: int, value: int) -> None:
        """Store a measurement in an integer object, saturated at the range of its type."""
        lowest, highest = self._spans.get(where, (value, value))
        self.values[where] = lowest if value < lowest else highest if value > highest else value

    def restore(self, first: int, last: int) -> None:
        """Set all objects with first <= index <= last to their defaults."""
        for k, entry in self.entries.items():
            if first <= k >> 8 <= last:
                self.values[k] = entry.default

    def number(self, index: int, subindex: int = 0) -> int:
        """Value of a numeric object; 0 if the EDS lacks it."""
        value = self.values.get(index << 8 | subindex, 0)  # `key` inlined for speed
        assert isinstance(value, int)
        return value

    def read(self, index: int, subindex: int) -> bytes:
        """Data of an SDO upload. Raises SdoAbortedError."""
        entry = self._find(index, subindex)
        if not entry.readable:
            raise SdoAbortedError(WRITE_ONLY)
        value = self.values[key(index, subindex)]
        return value if isinstance(value, bytes) else struct.pack("<" + entry.code, value)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write by an SDO download. Raises SdoAbortedError."""
        entry = self._find(index, subindex)
        if not entry.writable:
            raise SdoAbortedError(READ_ONLY)
        if len(data) != struct.calcsize(entry.code):
            raise SdoAbortedError(LENGTH_MISMATCH)
        value: int = struct.unpack("<" + entry.code, data)[0]
        self._check(key(index, subindex), entry, value)
        self.values[key(index, subindex)] = value
        self.written(key(index, subindex))

    def accepts(self, where: int, value: int) -> bool:
        """True if an RPDO may set the object to this value."""
        try:
            self._check(where, self.entries[where], value)
        except SdoAbortedError:
            return False
        return True

    def _check(self, where: int, entry: Entry, value: int) -> None:
        if entry.high is not None and value > entry.high:
            raise SdoAbortedError(TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise SdoAbortedError(TOO_LOW)
        guard = self.guards.get(where >> 8)
        if guard is not None:
            guard(where & 0xFF, value)

    def _find(self, index: int, subindex: int) -> Entry:
        entry = self.entries.get(key(index, subindex))
        if entry is None:
            raise SdoAbortedError(NO_SUBINDEX if index in self._indices else NO_OBJECT)
        return entry


@cache
def entries(eds: Path, node: int) -> dict[int, Entry]:
    """All variables of the EDS, with missing values supplied. Raises ConfigurationError. Cached, as
    reading takes 10 ms per drive."""
    sheet = read_eds(eds)
    objects = {**sheet.objects, **supplied(sheet)}
    return {key(*place): _entry(one, node) for place, one in objects.items()}


def _entry(one: EdsObject, node: int) -> Entry:
    code = FORMATS.get(one.type, "")
    default = one.of_node(node)
    number = default if isinstance(default, int) else 0
    # Each entry holds a node ID and a time, but some EDS limit it as if it were a time only.
    limits = (None, None) if one.index == HEARTBEATS else (one.low, one.high)
    return Entry(
        code=code,
        readable="r" in one.access or one.access == "const",
        writable=one.writable,
        mappable=one.mappable,
        low=limits[0],
        high=limits[1],
        default=number if code else str(default or "").encode("ascii", "replace"),
    )
