"""Files that a daemon runs by, and which of them say something else by now.

Compared by content: a file that was only touched, or written anew as it was, has not changed. What
cannot be read any more has.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from daemon.config.load import Robot
from regular_file import LARGEST_TEXT_BYTES, open_regular

Stamp = tuple[int, int, int]
"""inode, size, time of the last change [ns]"""


@dataclass(slots=True)
class Files:
    """Files of one robot, by the names that its configuration gives them, each with the digest of
    what was read; None: there was none."""

    folder: Path
    read: Mapping[str, str | None]
    _looked: dict[str, tuple[Stamp | None, bool]] = field(default_factory=dict)

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """Those of a robot: what it holds as text counts as it was read, the others as they are
        now."""
        c = robot.configuration
        read = {
            robot.path.name: _digest(robot.text.encode()),
            c.urdf: _digest(robot.urdf.encode()),
            c.identified: _digest(robot.identified_text.encode()) if robot.identified else None,
        }
        others = [profile.eds for profile in c.drives.values()]
        if c.trajectory.file is not None:
            others.append(c.trajectory.file)
        files = cls(robot.folder, read | {name: _content(robot.folder / name) for name in others})
        files.changed()  # so that nothing is read later, unless it is written
        return files

    def changed(self) -> list[str]:
        """Names of those that say something else now. Asks the file system for each, and reads only
        those that were written since it last asked."""
        return [name for name in self.read if self._differs(name)]

    def _differs(self, name: str) -> bool:
        path = self.folder / name
        stamp = _stamp(path)
        before = self._looked.get(name)
        if before is not None and before[0] == stamp:
            return before[1]
        differs = _content(path) != self.read[name]
        self._looked[name] = stamp, differs
        return differs


def _stamp(path: Path) -> Stamp | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _content(path: Path) -> str | None:
    try:
        with open_regular(path) as stream:
            # No more room than it takes: a process that locks its memory pays for all of it.
            size = os.fstat(stream.fileno()).st_size
            return _digest(stream.read(size)) if size <= LARGEST_TEXT_BYTES else None
    except OSError:
        return None


def _digest(content: bytes) -> str:
    # Text is read with universal newlines, of which a lone carriage return is one.
    lines = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return hashlib.sha256(lines).hexdigest()
