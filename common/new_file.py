"""New files: checks of the name before anything is recorded, and files that appear under their name
only when complete."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

from common.errors import LogError


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
