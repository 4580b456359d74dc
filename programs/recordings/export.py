"""Conversion of recordings to Foxglove's schemas and CSV."""

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final

from common.errors import LogError, ModelError
from common.new_file import whole_file
from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import read_batches

DRAW_EVERY: Final = 3  # ticks between drawings of the arm: 33 per second at 100 Hz
_LAST_NS: Final = (2**32 - 1) * 10**9  # largest Timestamp of Foxglove
#: Columns of the CSV, beginning with those that `contactd identify --log` reads.
CSV_COLUMNS: Final = (
    "current",
    "link_position",
    "motor_velocity",
    "motor_position",
    "link_velocity",
    "phi",
    "residual",
    "threshold",
)


def export_foxglove(
    path: Path, target: Path, progress: Callable[[float], None] = lambda share: None
) -> str:
    """Write a recording as an MCAP file of Foxglove's schemas; returns why the recording ends
    early, or empty. Raises LogError, also without the library."""
    try:
        from foxglove import Context, open_mcap  # noqa: PLC0415 - an extra

        from programs.recordings.foxglove import FoxgloveChannels  # noqa: PLC0415
    except ImportError as error:
        raise LogError(
            "--foxglove needs foxglove-sdk (pip install 'contactd[foxglove]')"
        ) from error
    context = Context()
    with whole_file(target) as partial, partial.open("wb") as stream:
        sink = _Sink(stream)
        channels: FoxgloveChannels | None = None
        snapshot: Snapshot | None = None
        clock = Clock()

        def take(batch: Snapshot | list[State]) -> None:
            nonlocal channels, snapshot
            if isinstance(batch, Snapshot):
                snapshot = snapshot or batch
                return
            assert snapshot is not None
            try:
                channels = channels or FoxgloveChannels(
                    context, snapshot, list(batch[0].beside), DRAW_EVERY
                )
            except ModelError as error:
                raise LogError(f"{path}: {error}") from error
            for state in batch:
                channels.log(state, clock.time_ns(state))
            sink.check()

        with open_mcap(sink, context=context):
            broken = read_batches(path, take, progress)
        sink.check()
        return broken


def export_csv(
    path: Path, target: Path, progress: Callable[[float], None] = lambda share: None
) -> str:
    """Write a recording as a CSV file with a row per tick; returns as `export_foxglove`."""
    with whole_file(target) as partial, partial.open("wb") as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=False)
        rows = csv.writer(text, lineterminator="\n")
        fields: list[str] = []
        joints: list[str] = []

        def take(batch: Snapshot | list[State]) -> None:
            nonlocal fields, joints
            if isinstance(batch, Snapshot):
                joints = joints or batch.joints
                return
            if not fields:
                fields = [name for name in CSV_COLUMNS if getattr(batch[0], name) is not None]
                named = [f"{name}.{joint}" for name in fields for joint in joints]
                rows.writerow(["time", "tick", "mode", "armed", *named])
            for state in batch:
                values = [value for name in fields for value in getattr(state, name)]
                rows.writerow(
                    [state.time_s, state.tick, str(state.mode), int(state.armed), *values]
                )

        try:
            return read_batches(path, take, progress)
        finally:
            text.flush()
            text.detach()


class Clock:
    """Unix time of States: wall-clock time at the first State, continued by the loop time, which
    never jumps."""

    def __init__(self) -> None:
        self._begun: tuple[float, float] | None = None

    def time_ns(self, state: State) -> int:
        """Time of a State [ns]."""
        wall_s, loop_s = self._begun = self._begun or (state.timing.wall_s, state.time_s)
        return min(max(round((wall_s + state.time_s - loop_s) * 1e9), 0), _LAST_NS)


class _Sink:
    """File object for the library's writer. It keeps the first error and ignores later writes, as
    the library would continue and print a line for every message."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._at = self._end = 0
        self._error: OSError | None = None

    def write(self, data: bytes | bytearray) -> int:
        """Write data, unless an operation failed before."""
        self._try(lambda: self._stream.write(data))
        self._at += len(data)
        self._end = max(self._end, self._at)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the file position, and return it."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._end}[whence]
        self._try(lambda: self._stream.seek(self._at))
        return self._at

    def flush(self) -> None:
        """Flush the file, unless an operation failed before."""
        self._try(self._stream.flush)

    def check(self) -> None:
        """Raise the first error, if any."""
        if self._error is not None:
            raise self._error

    def _try(self, work: Callable[[], object]) -> None:
        if self._error is None:
            try:
                work()
            except OSError as error:
                self._error = error
