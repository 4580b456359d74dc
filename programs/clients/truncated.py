"""Handling of a recording that was cut short, such as by a full disk."""

import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from common.errors import LogError


def truncated(path: Path, error: OSError, holds_any: Callable[[Path], bool]) -> LogError:
    """Error for a recording to the new file `path`, which states whether anything was recorded. The
    file is removed if `holds_any` finds nothing in it."""
    why = f"cannot write {path}: {error.strerror or error}"
    if holds_any(path):
        return LogError(f"{why}; it holds what was recorded until then")
    with suppress(OSError):
        if stat.S_ISREG(path.lstat().st_mode):  # never a device
            path.unlink()
    return LogError(f"{why}; nothing was recorded")


def holds_a_row(path: Path) -> bool:
    """True if a CSV file has a complete row below its header; truncates an incomplete last row."""
    try:
        with path.open("r+b") as stream:
            text = stream.read()
            stream.truncate(text.rfind(b"\n") + 1)
    except OSError:
        return True  # unknown, so the file is kept
    return text.count(b"\n") > 1
