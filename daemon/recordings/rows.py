"""Rows of a recording: what decides about contacts, as arrays with one row per tick.

They are read once and kept as files of columns in the user's cache, by the recording's content: the
next question about it takes a fraction of a second. Rows come in parts, so that memory does not
grow with the recording.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from daemon.clients.replay import batches
from daemon.config.load import parse_configuration
from daemon.modes.table import SENSING, YIELDING
from daemon.protocol.messages import Snapshot, State
from errors import LogError
from regular_file import open_regular

PART: Final = 16384  # rows at once
LAYOUT: Final = 2  # of the cache's files
_LEARNS_SINCE: Final = 4  # format
MOST_BYTES: Final = 4 << 30  # of all recordings in the cache
_SENSING: Final = frozenset(mode.value for mode in SENSING)
_YIELDING: Final = frozenset(mode.value for mode in YIELDING)
_FLOATS: Final = ("residual", "threshold", "level_share")


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Consecutive ticks, (ticks,) or (ticks, n); torques [Nm]."""

    time_s: Vector
    """from the first State of the recording"""
    follows: bool
    """no tick is missing before the first"""
    reports: NDArray[np.bool_]
    """joints whose contacts were reported: the arm was energised and the joint did sense"""
    residual: Matrix
    threshold: Matrix
    """in force"""
    level_share: Matrix
    """share of the configured level in force; 1 where nobody said it"""


class RowsHeader(msgspec.Struct, frozen=True, kw_only=True):
    """What all rows of a recording share."""

    joints: list[str]
    contact: list[float]  # configured levels [Nm]
    debounce: int  # [ticks]
    learned: bool  # learning was on
    shares_known: bool  # level_share was recorded
    residual: str  # name of the one that decided
    beside: list[str]
    rows: int
    period_s: float  # that a row stands for
    stretches: list[int]  # rows before which ticks are missing
    duration_s: float
    reaction_s: float | None  # when the arm first reacted to a contact
    broken: str = ""  # reason why the recording ends early


def cache_directory() -> Path:
    """Contactd's folder in the user's cache."""
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
    """The columns of one recording in the cache; they are read if they are not there yet.

    Raises LogError for a recording that cannot be read.
    """

    def __init__(
        self,
        path: Path,
        digest: str,
        cache: Path | None = None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        root = (cache or cache_directory()) / "columns"
        self._folder = root / f"{digest}-{LAYOUT}"
        header = self._folder / "header.json"
        if not header.exists():
            _fill(path, self._folder, progress)
            _forget_oldest(root, keep=self._folder)
        with contextlib.suppress(OSError):
            os.utime(self._folder)  # used last
        self.header = msgspec.json.decode(header.read_bytes(), type=RowsHeader)

    def parts(self, residual: str = "") -> Iterator[Rows]:
        """All rows, with the residual of that name, by default the one that decided. Raises
        LogError if it was not recorded."""
        h = self.header
        if residual in ("", h.residual):
            name = "residual"
        elif residual in h.beside:
            name = _beside(h.beside.index(residual))
        else:
            known = ", ".join([h.residual, *h.beside])
            raise LogError(f"has no residual {residual!r}; there are: {known}")
        edges = sorted({0, h.rows, *h.stretches, *range(0, h.rows, PART)})
        n = len(h.joints)
        with contextlib.ExitStack() as stack:

            def opened(column: str) -> IO[bytes]:
                return stack.enter_context((self._folder / column).open("rb"))

            time_s, reports = opened("time_s"), opened("reports")
            r, threshold, share = map(opened, (name, "threshold", "level_share"))
            for begin, end in pairwise(edges):
                count = end - begin

                def rows(stream: IO[bytes], count: int = count) -> Matrix:
                    return np.fromfile(stream, np.float64, count * n).reshape(count, n)

                yield Rows(
                    time_s=np.fromfile(time_s, np.float64, count),
                    follows=begin > 0 and begin not in h.stretches,
                    reports=np.fromfile(reports, np.bool_, count * n).reshape(count, n),
                    residual=rows(r),
                    threshold=rows(threshold),
                    level_share=rows(share),
                )


def _fill(path: Path, folder: Path, progress: Callable[[float], None]) -> None:
    """Write the columns of a recording; the folder gets its name when they are whole."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
        try:
            with contextlib.ExitStack() as stack:
                header = _write(path, partial, stack, progress)
            (partial / "header.json").write_bytes(msgspec.json.encode(header))
            partial.rename(folder)
        except OSError:
            if not (folder / "header.json").exists():  # nobody else was faster
                raise
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror or error}") from error


def _write(
    path: Path, folder: Path, stack: contextlib.ExitStack, progress: Callable[[float], None]
) -> RowsHeader:
    """Columns of `path` as files in `folder`."""
    files: dict[str, IO[bytes]] = {}

    def put(name: str, values: NDArray[Any]) -> None:
        if name not in files:
            files[name] = stack.enter_context((folder / name).open("wb"))
        files[name].write(values.tobytes())

    gatherer: RowsGatherer | None = None
    broken = ""
    try:
        for batch in batches(path, progress):
            if isinstance(batch, Snapshot):
                gatherer = gatherer or RowsGatherer(batch)
                gatherer.refuse_other_arm(path, batch)
                continue
            assert gatherer is not None
            for name, values in gatherer.columns(batch).items():
                put(name, values)
    except LogError as error:
        if gatherer is None or not gatherer.rows:
            raise
        broken = str(error)
    if gatherer is None or not gatherer.rows:
        raise LogError(f"{path} is a recording without any state")
    return gatherer.header(broken)


def _beside(number: int) -> str:
    """File of a residual that ran beside: its name may be anything, a path, too."""
    return f"beside_{number}"


class RowsGatherer:
    """Makes the columns of one recording, batch by batch."""

    def __init__(self, snapshot: Snapshot) -> None:
        c = parse_configuration(
            snapshot.configuration, "the recorded configuration", snapshot.identified
        )
        self._joints, self._configuration = tuple(snapshot.joints), c
        self._n, self._format = len(self._joints), snapshot.format
        self._beside: tuple[str, ...] | None = None
        self.rows = 0
        self._stretches: list[int] = []
        self._begun_s = self._ended_s = 0.0
        self._tick = -1
        self._reaction_s: float | None = None
        self._mode = ""
        self._shares_known = True

    def refuse_other_arm(self, path: Path, snapshot: Snapshot) -> None:
        """Raise LogError for the snapshot of another arm."""
        if tuple(snapshot.joints) != self._joints:
            raise LogError(f"{path} has recordings of two arms in it")

    def columns(self, states: Sequence[State]) -> dict[str, NDArray[Any]]:
        """Columns of the next States, by the name of their file."""
        if self._beside is None:
            self._beside, self._begun_s = tuple(states[0].beside), states[0].time_s
        elif states[0].tick != self._tick + 1:
            self._stretches.append(self.rows)
        for k, state in enumerate(states):
            if k and state.tick != states[k - 1].tick + 1:
                self._stretches.append(self.rows + k)
            self._heed(state)
        self._tick, self._ended_s = states[-1].tick, states[-1].time_s
        self.rows += len(states)
        if states[0].level_share is None:
            self._shares_known = False
        ones = [1.0] * self._n
        never, always = [False] * self._n, [True] * self._n
        reports = [
            (state.sensing or always) if state.mode in _SENSING else never for state in states
        ]
        return {
            "time_s": np.array([state.time_s for state in states]) - self._begun_s,
            "reports": np.array(reports, dtype=np.bool_),
            "residual": np.array([state.residual for state in states]),
            "threshold": np.array([state.threshold for state in states]),
            "level_share": np.array([state.level_share or ones for state in states]),
            **{_beside(k): self._of_variant(states, name) for k, name in enumerate(self._beside)},
        }

    def _of_variant(self, states: Sequence[State], name: str) -> Matrix:
        nothing = [0.0] * self._n
        found = [state.beside.get(name, nothing) for state in states]
        return np.array([row if len(row) == self._n else nothing for row in found])

    def _heed(self, state: State) -> None:
        if self._reaction_s is None:
            changed = any(notice.kind == "mode" for notice in state.notices)
            touched = any(notice.contact is not None for notice in state.notices)
            if state.mode in _YIELDING or (changed and touched):
                self._reaction_s = state.time_s - self._begun_s

    def header(self, broken: str) -> RowsHeader:
        """What the rows share."""
        c = self._configuration
        return RowsHeader(
            joints=list(self._joints),
            contact=[joint.thresholds.contact for joint in c.joints],
            debounce=c.estimator.debounce,
            learned=c.estimator.learning and self._format >= _LEARNS_SINCE,
            shares_known=self._shares_known,
            residual=c.estimator.residual.name,
            beside=list(self._beside or ()),
            rows=self.rows,
            period_s=c.period_s,
            stretches=self._stretches,
            duration_s=self._ended_s - self._begun_s,
            reaction_s=self._reaction_s,
            broken=broken,
        )


def _forget_oldest(root: Path, keep: Path) -> None:
    """Remove the columns that were used longest ago, beyond MOST_BYTES."""
    with contextlib.suppress(OSError):
        folders = sorted(root.glob(f"*-{LAYOUT}"), key=lambda f: f.stat().st_mtime, reverse=True)
        total = 0
        for folder in folders:
            total += sum(file.stat().st_size for file in folder.iterdir())
            if total > MOST_BYTES and folder != keep:
                shutil.rmtree(folder, ignore_errors=True)
