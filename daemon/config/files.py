"""Files that the daemon has loaded, and detection of those that have changed since.

Files are compared by content: one that was only touched, or rewritten with the same content, has
not changed; one that has become unreadable has. The loop checks between two ticks, so a large file
is read in chunks, and counts as changed until its end has been read.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from common.regular_file import LARGEST_TEXT_BYTES, open_regular
from daemon.config.load import Robot
from daemon.config.shapes import SHAPES, SURROUNDINGS

Stamp = tuple[int, int, int]
"""Inode, size, modification time [ns]"""
PIECE_BYTES: Final = 1 << 16  # read at once; 0.5 ms


@dataclass(slots=True)
class Files:
    """Files of one robot by their names in its configuration, each with the digest of its content
    when it was loaded; None if it did not exist."""

    folder: Path
    read: Mapping[str, str | None]
    _looked: dict[str, tuple[Stamp | None, bool]] = field(default_factory=dict)
    _reading: "_Reading | None" = None  # the file being read; one at a time

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """Files of a robot. Digests are of the text that it holds in memory, where it does, and of
        the present content on disk otherwise."""
        c = robot.configuration
        read = {
            robot.path.name: _digest(robot.text.encode()),
            c.urdf: _digest(robot.urdf.encode()),
            c.identified: _digest(robot.identified_text.encode()) if robot.identified else None,
        }
        others = [name for profile in c.drives.values() for name in profile.files]
        if c.trajectory.file is not None:
            others.append(c.trajectory.file)
        others += [SHAPES, SURROUNDINGS]
        folder = robot.folder
        files = cls(folder, read | {name: _content(folder / name) for name in others})
        for name, digest in files.read.items():  # files are read again only after a change
            stamp = _stamp(folder / name)
            files._looked[name] = stamp, _content(folder / name) != digest
        return files

    def changed(self) -> list[str]:
        """Names of files whose content differs, or may differ. Calls stat on each, and reads a
        chunk of a file that was modified since the last call."""
        return [name for name in self.read if self._differs(name)]

    def look_on(self) -> None:
        """Read the next chunk of the file being read, if any."""
        if self._reading is not None:
            self._differs(self._reading.name)

    def _differs(self, name: str) -> bool:
        path = self.folder / name
        stamp = _stamp(path)
        before = self._looked.get(name)
        if before is not None and before[0] == stamp:
            return before[1]
        reading = self._reading
        if reading is not None and reading.name != name:
            return True  # one at a time
        if reading is None or reading.stamp != stamp:
            reading = self._reading = _Reading(name, stamp)
        if not reading.goes_on(path):
            return True
        differs = reading.digest != self.read[name]
        self._looked[name] = stamp, differs
        self._reading = None
        return differs


@dataclass(slots=True)
class _Reading:
    """Reading of a file in chunks."""

    name: str
    stamp: Stamp | None
    digest: str | None = None  # None: unreadable
    _hash: "hashlib._Hash" = field(default_factory=hashlib.sha256)
    _offset: int = 0
    _held: bytes = b""  # a carriage return at the end of the last chunk: a line feed may follow

    def goes_on(self, path: Path) -> bool:
        """Read the next chunk; True at the end, or if it cannot be read."""
        if self.stamp is None or self.stamp[1] > LARGEST_TEXT_BYTES:
            return True
        try:
            with open_regular(path) as stream:
                stream.seek(self._offset)
                piece = stream.read(PIECE_BYTES)
        except OSError:
            return True
        self._offset += len(piece)
        text = self._held + piece
        ended = self._offset >= self.stamp[1] or not piece
        self._held = b"\r" if text.endswith(b"\r") and not ended else b""
        self._hash.update(_lines(text[: len(text) - len(self._held)]))
        self.digest = self._hash.hexdigest() if ended else None
        return ended


def _stamp(path: Path) -> Stamp | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _content(path: Path) -> str | None:
    try:
        with open_regular(path) as stream:
            # Exact size: with locked memory, a larger buffer would stay resident.
            size = os.fstat(stream.fileno()).st_size
            return _digest(stream.read(size)) if size <= LARGEST_TEXT_BYTES else None
    except OSError:
        return None


def _digest(content: bytes) -> str:
    return hashlib.sha256(_lines(content)).hexdigest()


def _lines(content: bytes) -> bytes:
    # Text is read with universal newlines, which include a lone carriage return.
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
