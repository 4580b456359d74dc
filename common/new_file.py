"""New files: checks of the name before anything is recorded, and files that appear under their name
only when complete."""

import fcntl
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

from common.errors import ConfigurationError, LogError

_WAIT_S = 5.0  # for a lock, under which only a small file is read and written


def refuse_suffix(path: Path, allowed: Sequence[str]) -> None:
    """Raise LogError unless the name of `path` ends in one of the suffixes `allowed`, in any
    case."""
    if path.suffix.lower() not in allowed:
        raise LogError(f"{path}: must end in {', '.join(allowed[:-1])} or {allowed[-1]}")


def refuse_unless_new(path: Path) -> None:
    """Raise LogError if `path` exists, or if its existence cannot be checked."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}") from error
    raise LogError(f"{path} exists: it is never overwritten")


def open_new(path: Path, mode: Literal["x", "xb"], **how: Any) -> IO[Any]:
    """Create the file `path` and open it for writing. Raises LogError."""
    try:
        return path.open(mode, **how)
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Path beside `target`, with the same suffix, to be written within the block. It is renamed to
    `target` when the block ends, and removed if the block fails. Raises LogError if it cannot be
    written. An existing target that is not a regular file (a device, a pipe) is written in
    place."""
    real = Path(os.path.realpath(target))  # a symbolic link is kept: its target is replaced
    in_place = os.path.exists(real) and not os.path.isfile(real)
    partial = real if in_place else real.with_name(f".{real.name}.partial{real.suffix}")
    try:
        yield partial
        if not in_place:
            partial.replace(real)
    except OSError as error:
        raise LogError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if not in_place:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock for the block, between processes that read `path` and replace it. Raises
    ConfigurationError if another holds it for longer than 5 s."""
    try:
        until, folder = time.monotonic() + _WAIT_S, os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be written: {error.strerror}") from error
    try:
        while True:
            try:
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > until:
                    text = f"{path} is locked by another command: try again when it has ended"
                    raise ConfigurationError(text) from None
                time.sleep(0.05)
                continue
            except OSError:  # a file system without locks of folders, such as NFS
                pass
            break
        yield
    finally:
        os.close(folder)
