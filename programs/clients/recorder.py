"""Recorder of the daemon's stream to an MCAP file.

Channel `/state` has one message per tick, with the bytes that the daemon sent, so that a replay can
be bit-identical; channel `/snapshot` has the context, at the start and after every gap. Foxglove
and PlotJuggler can open such files.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import msgspec

from common.errors import UnreachableError
from common.new_file import open_new, refuse_unless_new
from daemon.protocol.state import Snapshot, State
from programs.clients.client import Client
from programs.clients.log_reader import holds_a_state
from programs.clients.log_writer import LogWriter
from programs.clients.truncated import truncated


@dataclass(frozen=True, slots=True)
class Recording:
    """Result of `record`; `lost` counts the ticks missing between the first and the last State."""

    path: str
    duration_s: float
    states: int
    lost: int
    snapshots: int
    ended: str  # why it ended early, or empty

    def __str__(self) -> str:
        again = f", {self.snapshots} snapshots" if self.snapshots > 1 else ""
        return f"{self.duration_s:.1f} s, {self.states} states, {self.lost} lost{again}"


class _Wall(msgspec.Struct):
    wall_s: float


class _Stamp(msgspec.Struct):
    """Fields of a State that the recorder reads."""

    tick: int
    time_s: float
    timing: _Wall


def record(
    connect: Callable[[], Client],
    path: Path,
    *,
    seconds: float | None = None,
    stop: Callable[[], bool] = lambda: False,
    begun: Callable[[], None] = lambda: None,
) -> Recording:
    """Write the daemon's stream to `path` until `stop()`, for `seconds`, or until it ends. `begun`
    is called once the recording has begun.

    After missing ticks it subscribes again and writes a new snapshot. The file is always finished
    properly; if the disk is full, it keeps what was recorded, or is removed if that is nothing.
    Raises LogError if `path` exists or cannot be written, ControlError if there is no daemon at the
    start.
    """
    refuse_unless_new(path)
    client = connect()
    try:
        snapshot, _ = client.subscribe()
        stream = open_new(path, "xb")
        try:
            with stream:
                log = _StreamWriter(stream, snapshot)
                begun()
                try:
                    ended = _follow(client, connect, log, seconds, stop)
                finally:
                    log.finish()
        except OSError as error:
            raise truncated(path, error, holds_a_state) from error
    finally:
        client.close()
    return Recording(str(path), log.duration_s, log.states, log.lost, log.snapshots, ended)


def _follow(
    client: Client,
    connect: Callable[[], Client],
    log: "_StreamWriter",
    seconds: float | None,
    stop: Callable[[], bool],
) -> str:
    """Write the stream to `log`; returns why the daemon ended it, or empty."""
    decoder = msgspec.json.Decoder(_Stamp)
    first = client
    try:
        while not stop() and (seconds is None or log.duration_s < seconds):
            packet = client.packet()
            stamp = decoder.decode(packet)
            if log.is_gap(stamp.tick):
                if client is not first:
                    client.close()
                client = connect()
                log.snapshot(client.subscribe()[0])
            else:
                log.state(packet, stamp)
    except UnreachableError as error:
        return str(error)
    except msgspec.DecodeError as error:
        return f"the daemon has another version: {error}"
    finally:
        if client is not first:
            client.close()
    return ""


class _StreamWriter:
    """Writer of the stream; a snapshot is held back until its first State, whose time it gets."""

    def __init__(self, stream: IO[bytes], snapshot: Snapshot) -> None:
        self._stream = stream
        self._writer = LogWriter(stream, snapshot.program)
        self._pending: Snapshot | None = snapshot
        self._first: _Stamp | None = None
        self._last: _Stamp | None = None
        self.states = 0
        self.lost = 0
        self.snapshots = 0

    @property
    def duration_s(self) -> float:
        if self._first is None or self._last is None:
            return 0.0
        return self._last.time_s - self._first.time_s

    def is_gap(self, tick: int) -> bool:
        """True if ticks are missing before `tick`, and no new snapshot is pending."""
        return self._pending is None and self._last is not None and tick > self._last.tick + 1

    def snapshot(self, snapshot: Snapshot) -> None:
        self._pending = snapshot

    def state(self, packet: bytes, stamp: _Stamp) -> None:
        """Write one State; skip it if it is not newer than the last one and the snapshot."""
        newest = -1 if self._last is None else self._last.tick
        if self._pending is not None:
            newest = max(newest, self._pending.tick)
        if stamp.tick <= newest:
            return
        wall_s = stamp.timing.wall_s
        if self._pending is not None:
            self._writer.write(Snapshot, msgspec.json.encode(self._pending), wall_s)
            self._pending = None
            self.snapshots += 1
        self._writer.write(State, packet, wall_s)
        self.states += 1
        if self._last is not None:
            self.lost += stamp.tick - self._last.tick - 1
        self._stream.flush()  # writes only once per chunk
        self._first = self._first or stamp
        self._last = stamp

    def finish(self) -> None:
        self._writer.finish()
