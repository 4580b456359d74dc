"""Cache of recordings' columns, by the recordings' content, in the user's cache folder.

A recording is read once, so that further questions take a fraction of a second. Damaged columns are
made again; if the cache is not writable, columns are temporary.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix
from common.errors import LogError
from common.regular_file import open_regular
from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import read_batches
from programs.recordings.rows import (
    MATRICES,
    Rows,
    RowsGatherer,
    RowsHeader,
    beside_column,
    chosen_residual,
)

PART: Final = 16384  # rows read at once
LAYOUT: Final = 4  # version of the files
PARTIAL_S: Final = 24 * 3600.0  # age at which a partial folder counts as abandoned
MOST_BYTES: Final = 2 << 30  # size limit of one kind of cached data


def cache_directory() -> Path:
    """Folder of contactd in the user's cache."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "contactd"


def content_digest(path: Path) -> str:
    """Digest of a file's content. Raises LogError."""
    try:
        with open_regular(path) as stream:
            digest = hashlib.blake2b(digest_size=16)
            while part := stream.read(1 << 20):
                digest.update(part)
            return digest.hexdigest()
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error


class CachedRows:
    """Columns of one recording, read if they are not cached yet; must be closed. Raises LogError
    for a recording that cannot be read."""

    def __init__(
        self,
        path: Path,
        digest: str,
        cache: Path | None = None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        root = (cache or cache_directory()) / "columns"
        self._folder = root / f"{digest}-{LAYOUT}"
        self._passing: tempfile.TemporaryDirectory[str] | None = None
        header = _kept(self._folder)
        if header is None:
            if not _fill(path, self._folder, progress):
                self._passing = tempfile.TemporaryDirectory(prefix="contactd-columns-")
                self._folder = Path(self._passing.name)
                _write_folder(path, self._folder, progress)
            header = _kept(self._folder)
            forget_oldest(root, keep=self._folder)
        if header is None:
            raise LogError(f"cannot keep {path} in {self._folder}: another process wrote there")
        self.header = header
        with contextlib.suppress(OSError):
            os.utime(self._folder)  # marks it as recently used

    def close(self) -> None:
        """Delete temporary columns."""
        if self._passing is not None:
            self._passing.cleanup()

    def parts(self, residual: str = "") -> Iterator[Rows]:
        """All rows, with the named residual, by default the one that decided. Raises LogError if
        that was not recorded."""
        h = self.header
        number = chosen_residual(residual, h.residual, h.beside)
        name = "residual" if number is None else beside_column(number)
        edges = sorted({0, h.rows, *h.stretches, *range(0, h.rows, PART)})
        n = len(h.joints)
        with contextlib.ExitStack() as stack:

            def opened(column: str) -> IO[bytes]:
                return stack.enter_context((self._folder / column).open("rb"))

            time_s, reports, force = map(opened, ("time_s", "reports", "force_N"))
            matrices = {
                column: opened(name if column == "residual" else column) for column in MATRICES
            }
            for begin, end in pairwise(edges):
                count = end - begin

                def rows(stream: IO[bytes], count: int = count) -> Matrix:
                    return np.fromfile(stream, np.float64, count * n).reshape(count, n)

                yield Rows(
                    time_s=np.fromfile(time_s, np.float64, count),
                    follows=begin > 0 and begin not in h.stretches,
                    force_N=np.fromfile(force, np.float64, count),
                    reports=np.fromfile(reports, np.bool_, count * n).reshape(count, n),
                    **{column: rows(stream) for column, stream in matrices.items()},
                )


def _kept(folder: Path) -> RowsHeader | None:
    """Header of cached columns; None if they are missing or incomplete."""
    try:
        header = msgspec.json.decode((folder / "header.json").read_bytes(), type=RowsHeader)
        rows, values = header.rows, header.rows * len(header.joints)
        sizes = {"time_s": 8 * rows, "force_N": 8 * rows, "reports": values}
        besides = [beside_column(k) for k in range(len(header.beside))]
        sizes |= dict.fromkeys([*MATRICES, *besides], 8 * values)
        complete = all((folder / name).stat().st_size == size for name, size in sizes.items())
    except (OSError, msgspec.DecodeError, UnicodeDecodeError):
        return None
    return header if complete else None


def _fill(path: Path, folder: Path, progress: Callable[[float], None]) -> bool:
    """Cache the columns of a recording; False if they cannot be written. Raises LogError."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    except OSError:
        return False
    try:
        _write_folder(path, partial, progress)
        if _kept(folder) is None:  # unless another process was faster
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):
                partial.rename(folder)
    except _NoRoomError:
        return False
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return True


class _NoRoomError(LogError):
    """Error of columns that cannot be written."""


def _write_folder(path: Path, folder: Path, progress: Callable[[float], None]) -> None:
    try:
        with contextlib.ExitStack() as stack:
            header = _write(path, folder, stack, progress)
        (folder / "header.json").write_bytes(msgspec.json.encode(header))
    except OSError as error:
        raise _NoRoomError(f"cannot write {folder}: {error.strerror or error}") from error


def _write(
    path: Path, folder: Path, stack: contextlib.ExitStack, progress: Callable[[float], None]
) -> RowsHeader:
    """Write the columns of `path` as files in `folder`, and return their header."""
    files: dict[str, IO[bytes]] = {}

    def put(name: str, values: NDArray[Any]) -> None:
        if name not in files:
            files[name] = stack.enter_context((folder / name).open("wb"))
        files[name].write(values.tobytes())

    gatherer: RowsGatherer | None = None

    def take(batch: Snapshot | list[State]) -> None:
        nonlocal gatherer
        if isinstance(batch, Snapshot):
            gatherer = gatherer or RowsGatherer(batch)
            gatherer.refuse_other_arm(path, batch)
            return
        assert gatherer is not None
        for name, values in gatherer.columns(batch).items():
            put(name, values)

    broken = read_batches(path, take, progress)
    assert gatherer is not None
    # The cached reason omits the name, as the same content may have another one later.
    return gatherer.header(broken.removeprefix(f"{path} "))


def forget_oldest(root: Path, keep: Path) -> None:
    """Remove the least recently used folders below `root` beyond MOST_BYTES."""
    with contextlib.suppress(OSError):
        folders = sorted(root.glob("[!.]*"), key=lambda f: f.stat().st_mtime, reverse=True)
        total = 0
        for left in root.glob(".partial-*"):  # left by a process that was killed
            if time.time() - left.stat().st_mtime > PARTIAL_S:
                shutil.rmtree(left, ignore_errors=True)
        for folder in folders:
            total += sum(file.stat().st_size for file in folder.iterdir())
            if total > MOST_BYTES and folder != keep:
                shutil.rmtree(folder, ignore_errors=True)
