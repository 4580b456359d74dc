"""Truncated recording, such as by a full disk: what is left of it."""

import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from common.errors import LogError


def truncated(path: Path, error: OSError, holds_any: Callable[[Path], bool]) -> LogError:
    """Error of a recording into the new file `path`, which states whether anything is in it. A file
    in which `holds_any` finds nothing recorded is removed."""
    why = f"cannot write {path}: {error.strerror or error}"
    if holds_any(path):
        return LogError(f"{why}; it holds what was recorded until then")
    with suppress(OSError):
        if stat.S_ISREG(path.lstat().st_mode):  # never a device
            path.unlink()
    return LogError(f"{why}; nothing was recorded")


def holds_a_row(path: Path) -> bool:
    """True if a CSV file has a whole row below its head; half a row at its end is cut off."""
    try:
        with path.open("r+b") as stream:
            text = stream.read()
            stream.truncate(text.rfind(b"\n") + 1)
    except OSError:
        return True  # not known, so it stays
    return text.count(b"\n") > 1
