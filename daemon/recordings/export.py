"""Recordings in other forms: Foxglove's schemas, CSV."""

import csv
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

from daemon.clients.recorder import read_log
from daemon.protocol.messages import Snapshot, State
from errors import LogError, ModelError

DRAW_EVERY: Final = 3  # ticks: 33 pictures of the arm a second at 100 Hz
_LAST_NS: Final = (2**32 - 1) * 10**9  # that a Timestamp of Foxglove can say
#: Columns of the CSV: the first of each joint are those that `contactd identify --log` reads.
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
    """Write a recording as an MCAP file of Foxglove's schemas; returns why it ends early, empty if
    it does not. Raises LogError, also without the library."""
    try:
        from foxglove import Context, open_mcap  # noqa: PLC0415 - an extra

        from daemon.recordings.foxglove import FoxgloveChannels  # noqa: PLC0415
    except ImportError as error:
        raise LogError(
            "--foxglove needs foxglove-sdk (pip install 'contactd[foxglove]')"
        ) from error
    context = Context()
    with _new_file(target) as stream, open_mcap(stream, context=context):
        channels: FoxgloveChannels | None = None
        snapshot: Snapshot | None = None
        clock = Clock()

        def write(message: Snapshot | State) -> None:
            nonlocal channels, snapshot
            if isinstance(message, Snapshot):
                snapshot = snapshot or message
                return
            assert snapshot is not None
            try:
                channels = channels or FoxgloveChannels(
                    context, snapshot, list(message.beside), DRAW_EVERY
                )
            except ModelError as error:
                raise LogError(f"{path}: {error}") from error
            channels.log(message, clock.time_ns(message))

        return _every(path, write, progress)


def export_csv(
    path: Path, target: Path, progress: Callable[[float], None] = lambda share: None
) -> str:
    """Write a recording as a CSV file, a row per tick, as `export_foxglove`."""
    with _new_file(target) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="", write_through=False)
        rows = csv.writer(text, lineterminator="\n")
        fields: list[str] = []
        joints: list[str] = []

        def write(message: Snapshot | State) -> None:
            nonlocal fields, joints
            if isinstance(message, Snapshot):
                joints = joints or message.joints
                return
            if not fields:
                fields = [name for name in CSV_COLUMNS if getattr(message, name) is not None]
                named = [f"{name}.{joint}" for name in fields for joint in joints]
                rows.writerow(["time", "tick", "mode", "armed", *named])
            values = [value for name in fields for value in getattr(message, name)]
            rows.writerow(
                [message.time_s, message.tick, str(message.mode), int(message.armed), *values]
            )

        try:
            return _every(path, write, progress)
        finally:
            text.flush()
            text.detach()


class Clock:
    """Unix time of States: the wall clock's at the first, from there on the loop's, which never
    jumps."""

    def __init__(self) -> None:
        self._begun: tuple[float, float] | None = None

    def time_ns(self, state: State) -> int:
        """Time of a State [ns]."""
        wall_s, loop_s = self._begun = self._begun or (state.timing.wall_s, state.time_s)
        return min(max(round((wall_s + state.time_s - loop_s) * 1e9), 0), _LAST_NS)


def _every(
    path: Path, write: Callable[[Snapshot | State], None], progress: Callable[[float], None]
) -> str:
    states = 0
    try:
        for message in read_log(path, progress):
            write(message)
            states += isinstance(message, State)
    except LogError as error:
        if not states:
            raise
        return str(error)
    if not states:
        raise LogError(f"{path} is a recording without any state")
    return ""


@contextmanager
def _new_file(target: Path) -> Iterator[IO[Any]]:
    """A file that gets its name when it is whole. Raises LogError if it cannot be written."""
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as stream:
            yield stream
        partial.rename(target)
    except OSError as error:
        raise LogError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
