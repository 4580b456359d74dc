"""Checks of the file named for a recording, made before anything is recorded."""

from collections.abc import Sequence
from pathlib import Path

from errors import LogError


def refuse_suffix(path: Path, allowed: Sequence[str]) -> None:
    """Raise LogError unless the name of `path` ends in one of `allowed`, in any case."""
    if path.suffix.lower() not in allowed:
        raise LogError(f"{path}: must end in {', '.join(allowed[:-1])} or {allowed[-1]}")


def refuse_unless_new(path: Path) -> None:
    """Raise LogError if `path` exists, or if its folder may not be searched."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}") from error
    raise LogError(f"{path} exists: it is never overwritten")
