"""CDR as used by ROS 2: the plain encoding (version 1) of the OMG, little-endian.

Strings and sequences are preceded by their length; numbers are aligned to their size, counted from
the end of the four-byte header. An implementation of our own, as the few messages are encoded every
tick (decision 0060).
"""

import struct
from collections.abc import Sequence
from typing import Final

HEADER: Final = b"\x00\x01\x00\x00"
LONGEST: Final = 1 << 18  # size of the largest message that is read


class CdrError(ValueError):
    """Error of bytes that are no message of the expected type."""


class Writer:
    """Encoder of a message; `payload` contains what was written so far."""

    def __init__(self) -> None:
        self.payload = bytearray(HEADER)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size`."""
        self.payload += bytes(-(len(self.payload) - len(HEADER)) % size)

    def byte(self, value: int) -> None:
        """Write one byte, or a bool."""
        self.payload.append(value)

    def int32(self, value: int) -> None:
        """Write a signed integer of 32 bits."""
        self.align(4)
        self.payload += struct.pack("<i", value)

    def uint32(self, value: int) -> None:
        """Write an unsigned integer of 32 bits."""
        self.align(4)
        self.payload += struct.pack("<I", value)

    def text(self, value: str) -> None:
        """Write a string in UTF-8, whose length includes the terminating zero."""
        encoded = value.encode("utf-8", "replace")
        self.uint32(len(encoded) + 1)
        self.payload += encoded + b"\0"

    def texts(self, values: Sequence[str]) -> None:
        """Write a sequence of strings."""
        self.uint32(len(values))
        for value in values:
            self.text(value)

    def doubles(self, count: int) -> int:
        """Reserve a sequence of `count` numbers; returns the offset of the first one."""
        self.uint32(count)
        if not count:
            return len(self.payload)
        self.align(8)
        self.payload += bytes(8 * count)
        return len(self.payload) - 8 * count


class Reader:
    """Decoder of a received message. All methods raise CdrError if the message ends too soon, is
    too long, or contains invalid values."""

    def __init__(self, payload: bytes) -> None:
        if payload[:4] not in (b"\x00\x01\x00\x00", b"\x00\x00\x00\x00") or len(payload) > LONGEST:
            raise CdrError(f"not plain CDR of at most {LONGEST} bytes")
        self._order = "<" if payload[1] else ">"
        self._payload, self._at = payload, len(HEADER)

    def byte(self) -> int:
        """Read one byte."""
        return self._take(1)[0]

    def uint32(self) -> int:
        """Read an unsigned integer of 32 bits."""
        self._at += -(self._at - len(HEADER)) % 4
        return int(struct.unpack(f"{self._order}I", self._take(4))[0])

    def text(self) -> str:
        """Read a string, replacing invalid UTF-8."""
        return self._take(self.uint32())[:-1].decode("utf-8", "replace")

    def texts(self, most: int) -> list[str]:
        """Read a sequence of at most `most` strings."""
        return [self.text() for _ in range(self._count(most))]

    def doubles(self, most: int) -> list[float]:
        """Read a sequence of at most `most` numbers."""
        if not (count := self._count(most)):
            return []
        self._at += -(self._at - len(HEADER)) % 8
        return list(struct.unpack(f"{self._order}{count}d", self._take(8 * count)))

    def _count(self, most: int) -> int:
        if (count := self.uint32()) > most:
            raise CdrError(f"a sequence of {count}, at most {most}")
        return count

    def _take(self, size: int) -> bytes:
        taken = self._payload[self._at : self._at + size]
        if len(taken) != size:
            raise CdrError("it ends too soon")
        self._at += size
        return taken


def refuse_unless_empty(payload: bytes) -> None:
    """Raise CdrError unless this is a message without fields, as of `std_srvs/srv/Trigger`. rmw
    writes one byte for it, as a struct in C needs a member."""
    if not 4 <= len(payload) <= 8 or payload[:2] not in (b"\x00\x01", b"\x00\x00"):
        raise CdrError("no Trigger request: a header of 4 bytes, and at most 4 more")


def read_flag(payload: bytes) -> bool:
    """Value of a message with a single bool, as of `std_srvs/srv/SetBool`. Raises CdrError for
    anything else."""
    if not 5 <= len(payload) <= 8 or payload[:2] not in (b"\x00\x01", b"\x00\x00"):
        raise CdrError("no SetBool request: a header of 4 bytes, a bool, and at most 3 more")
    if payload[4] > 1:
        raise CdrError(f"no SetBool request: a bool is 0 or 1, not {payload[4]}")
    return payload[4] == 1
