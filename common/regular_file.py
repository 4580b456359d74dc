"""Regular files, opened without ever blocking.

Opening a FIFO waits for a process at its other end, and reading /dev/zero never ends. A daemon that
must start or stop within seconds may find either under a configured name, so every file that is
named by a configuration, or derived from such a name, is opened here.
"""

import errno
import os
import stat
from pathlib import Path
from typing import IO, Final

#: Larger than any configuration, URDF, EDS or trajectory.
LARGEST_TEXT_BYTES: Final = 64 << 20


def open_regular(path: Path, *, follow: bool = True) -> IO[bytes]:
    """Open for reading; with follow=False symbolic links are refused, too.

    Raises OSError with a plain `strerror` for anything but a regular file.
    """
    return open(str(path), "rb", opener=_opened if follow else _opened_unless_link)


def open_text(
    path: Path, encoding: str = "utf-8", errors: str | None = None, newline: str | None = None
) -> IO[str]:
    """Open as text, with the arguments of `open`. Raises OSError as `open_regular` does, and for a
    file larger than `LARGEST_TEXT_BYTES`."""
    return open(
        str(path), encoding=encoding, errors=errors, newline=newline, opener=_opened_unless_large
    )


def read_text(path: Path) -> str:
    """Text of a UTF-8 file. Raises OSError, UnicodeDecodeError."""
    with open_text(path) as stream:
        return stream.read()


def _opened_unless_link(path: str, flags: int) -> int:
    try:
        return _opened(path, flags | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "is a link, not a file", path) from error
        raise


def _opened_unless_large(path: str, flags: int) -> int:
    file = _opened(path, flags)
    if os.fstat(file).st_size > LARGEST_TEXT_BYTES:
        os.close(file)
        raise OSError(errno.EFBIG, f"is larger than {LARGEST_TEXT_BYTES >> 20} MB", path)
    return file


def _opened(path: str, flags: int) -> int:
    try:
        file = os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket
            raise OSError(errno.EINVAL, "is not a regular file", path) from error
        raise
    if stat.S_ISDIR(mode := os.fstat(file).st_mode):
        why: OSError = IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    elif stat.S_ISREG(mode):
        return file
    else:
        why = OSError(errno.EINVAL, "is not a regular file", path)
    os.close(file)
    raise why
