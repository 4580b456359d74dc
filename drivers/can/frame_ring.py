"""Ring buffer of the last minute of raw frames, both directions, in a memory-mapped file.

The file outlives the daemon. Records have a fixed size, and writing one is a single `pack_into`: no
system call, no growth, no flush. The file belongs on a tmpfs (/run): the kernel never writes its
pages back, so that no tick waits for a disk. A record is visible to other processes at once, even
after the writer is killed.
"""

import mmap
import os
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.errors import LogError
from common.regular_file import open_regular
from drivers.can.wire import Frame, Wire

KEPT_S: Final = 60.0
_MAGIC: Final = b"contactd"
# Magic, version, capacity in records, and the offset from record times to the time of day [s].
_HEADER: Final = struct.Struct("<8sIId")
_HEADER_SIZE: Final = 64
# Time (monotonic) [s], number counting from 1, identifier with Linux flags, size, sent, data.
_RECORD: Final = struct.Struct("<dQIB?2x8s")
_RECORD_SIZE: Final = _RECORD.size
_PACK_INTO: Final = _RECORD.pack_into
_VERSION: Final = 1
_LARGEST_BYTES: Final = 64 << 20  # bound on the file size: enough for 40000 frames per second


@dataclass(frozen=True, slots=True)
class Recorded:
    """One frame as it was on the bus. time_s: seconds since the epoch."""

    time_s: float
    can_id: int
    data: bytes
    sent: bool


class FrameRing:
    """Ring that the owner of the bus writes; it keeps the last `capacity` frames."""

    def __init__(self, path: Path, capacity: int, clock: Callable[[], float]) -> None:
        """Create the file anew with all of its memory allocated. Raises OSError."""
        path.unlink(missing_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        file = os.open(path, flags, 0o640)
        try:
            size = _HEADER_SIZE + capacity * _RECORD.size
            os.posix_fallocate(file, 0, size)
            self._memory = mmap.mmap(file, size, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
        finally:
            os.close(file)
        self.path = path
        self.clock = clock
        to_wall_s = time.time() - clock()
        _HEADER.pack_into(self._memory, 0, _MAGIC, _VERSION, capacity, to_wall_s)
        self._capacity = capacity
        self._number = 0

    def put(self, time_s: float, can_id: int, data: bytes | bytearray, sent: bool) -> None:
        """Store a frame; it overwrites the oldest."""
        number = self._number = self._number + 1
        at = _HEADER_SIZE + number % self._capacity * _RECORD_SIZE
        _PACK_INTO(self._memory, at, time_s, number, can_id, len(data) & 0xFF, sent, data)

    def close(self) -> None:
        """Unmap the memory; the file stays."""
        self._memory.close()


class RecordedWire:
    """Wire whose frames are recorded in a ring."""

    def __init__(self, wire: Wire, ring: FrameRing) -> None:
        self._receive, self._send = wire.receive, wire.send
        self._put, self._clock = ring.put, ring.clock

    def receive(self, timeout: float) -> Frame | None:
        """Receive the next frame of the wire, and record it."""
        frame = self._receive(timeout)
        if frame is not None:
            self._put(self._clock(), frame[0], frame[1], False)
        return frame

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames on the wire, and record them unless it raises."""
        self._send(frames)
        now = self._clock()
        for can_id, data in frames:
            self._put(now, can_id, data, True)


def read_frames(path: Path) -> list[Recorded]:
    """All frames in a ring file, oldest first, whether or not its writer is alive.

    Raises LogError if the file is not a frame ring. A record that is being written meanwhile may be
    torn; it is left out if its time reveals that.
    """
    try:
        with open_regular(path, follow=False) as stream:
            content = stream.read(_LARGEST_BYTES)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    if len(content) < _HEADER_SIZE or not content.startswith(_MAGIC):
        raise LogError(f"{path}: not a frame ring")
    _, version, capacity, to_wall_s = _HEADER.unpack_from(content)
    if version != _VERSION or len(content) != _HEADER_SIZE + capacity * _RECORD.size:
        raise LogError(f"{path}: a frame ring of another version, or truncated")
    records = sorted(_RECORD.iter_unpack(content[_HEADER_SIZE:]), key=lambda record: record[1])
    frames: list[Recorded] = []
    latest = float("-inf")
    for time_s, number, can_id, size, sent, data in records:
        if number and time_s >= latest:
            frames.append(Recorded(time_s + to_wall_s, can_id, data[: min(size, 8)], sent))
            latest = time_s
    return frames
