"""Recordings: the daemon's stream as an MCAP file, and back.

Channel `/state` has one message per tick, its bytes as the daemon sent them, so that a replay sees
every bit; channel `/snapshot` has their context, once at the start and again after every gap.
Foxglove and PlotJuggler open such files.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, get_type_hints

import msgspec
from mcap.records import Channel, Header, Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from common.errors import LogError, UnreachableError
from common.new_file import open_new, refuse_unless_new
from common.regular_file import open_regular
from daemon.protocol.state import PerJoint, Snapshot, State, format_refusal
from daemon.protocol.strict_json import StrictDecoder
from daemon.protocol.text import printable
from programs.clients.client import Client
from programs.clients.cut_short import cut_short
from programs.clients.viewer_schema import viewer_schema

KINDS: dict[str, type[Snapshot] | type[State]] = {"/snapshot": Snapshot, "/state": State}
DECODERS: dict[type[Snapshot] | type[State], StrictDecoder[Any]] = {
    kind: StrictDecoder(kind) for kind in KINDS.values()
}
# Fields of a State with one entry per joint.
PER_JOINT = (
    "fresh",
    "drives",
    "side",
    *(name for name, kind in get_type_hints(State).items() if kind in (PerJoint, PerJoint | None)),
)
MAGIC = b"\x89MCAP0\r\n"
PROFILE = "contactd"
# Lost at most when the process is killed: 0.25 s of seven joints, 0.75 s of one, at 100 Hz. Files
# are 3 to 9 % larger than with 512 kB, at no more CPU time.
CHUNK_BYTES = 64 * 1024
PROGRESS_STATES = 1024  # between two reports of how far a file was read
RECORD_LIMIT_BYTES = 64 << 20  # a damaged length must not ask for all memory


@dataclass(frozen=True, slots=True)
class Recording:
    """Result of `record`; `lost` counts the ticks missing between the first and the last State."""

    path: str
    duration_s: float
    states: int
    lost: int
    snapshots: int
    ended: str  # empty if it ended as asked, else why not

    def __str__(self) -> str:
        again = f", {self.snapshots} snapshots" if self.snapshots > 1 else ""
        return f"{self.duration_s:.1f} s, {self.states} states, {self.lost} lost{again}"


class _Format(msgspec.Struct):
    """Version of a Snapshot, read before anything else of it."""

    format: int = 0


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
    """Write the daemon's stream to `path` until `stop()`, `seconds` have passed, or it ends.
    `begun` is called once the recording has begun.

    Where ticks are missing, it subscribes anew and writes a new snapshot. Whatever ends it, the
    file is finished properly; where the disk ends it, it holds what was recorded until then, and an
    empty one is removed. Raises LogError if `path` exists or cannot be written, ControlError
    if there is no daemon to begin with.
    """
    refuse_unless_new(path)
    client = connect()
    try:
        snapshot, _ = client.subscribe()
        stream = open_new(path, "xb")
        try:
            with stream:
                log = _LogWriter(stream, snapshot)
                begun()
                try:
                    ended = _follow(client, connect, log, seconds, stop)
                finally:
                    log.finish()
        except OSError as error:
            raise cut_short(path, error, holds_a_state) from error
    finally:
        client.close()
    return Recording(str(path), log.duration_s, log.states, log.lost, log.snapshots, ended)


def _follow(
    client: Client,
    connect: Callable[[], Client],
    log: "_LogWriter",
    seconds: float | None,
    stop: Callable[[], bool],
) -> str:
    """Feed `log`; returns why the daemon ended it, empty if it did not."""
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
        return f"the daemon speaks another version: {error}"
    finally:
        if client is not first:
            client.close()
    return ""


class _LogWriter:
    """Writer of the MCAP file: a snapshot waits for its first State, whose time it shares."""

    def __init__(self, stream: IO[bytes], snapshot: Snapshot) -> None:
        self._stream = stream
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library=snapshot.program)
        self._channels = {topic: self._channel(topic, kind) for topic, kind in KINDS.items()}
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
        """True if ticks are missing before `tick`, and no snapshot waits to make up for them."""
        return self._pending is None and self._last is not None and tick > self._last.tick + 1

    def snapshot(self, snapshot: Snapshot) -> None:
        self._pending = snapshot

    def state(self, packet: bytes, stamp: _Stamp) -> None:
        """Write one State as it came; skip one that is older than the last or than its snapshot."""
        newest = -1 if self._last is None else self._last.tick
        if self._pending is not None:
            newest = max(newest, self._pending.tick)
        if stamp.tick <= newest:
            return
        time_ns = round(stamp.timing.wall_s * 1e9)
        if self._pending is not None:
            self._write("/snapshot", time_ns, msgspec.json.encode(self._pending))
            self._pending = None
            self.snapshots += 1
        self._write("/state", time_ns, packet)
        self.states += 1
        if self._last is not None:
            self.lost += stamp.tick - self._last.tick - 1
        self._stream.flush()  # has work to do once per chunk
        self._first = self._first or stamp
        self._last = stamp

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, kind: type) -> int:
        data = msgspec.json.encode(viewer_schema(kind))
        schema = self._writer.register_schema(f"contactd.{kind.__name__}", "jsonschema", data)
        return self._writer.register_channel(topic, "json", schema)

    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        channel = self._channels[topic]
        self._writer.add_message(channel, log_time=time_ns, data=data, publish_time=time_ns)


def read_log(
    path: Path, progress: Callable[[float], None] = lambda share: None
) -> Iterator[Snapshot | State]:
    """Messages of a recording, in order, one at a time; `progress` gets the share of the file that
    was read, now and then.

    Raises LogError if `path` cannot be read, is no MCAP file, is no recording of contactd, is of a
    format that is not read here, or is damaged; of a file that ends in the middle, all whole
    messages come first.
    """
    try:
        stream = open_regular(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    states = joints = 0
    size = max(os.fstat(stream.fileno()).st_size, 1)
    last = "none"
    topics: dict[int, str] = {}
    with stream:
        try:
            for found in mcap_records(path, stream):
                if isinstance(found, Channel):
                    topics[found.id] = found.topic
                elif isinstance(found, Message) and (kind := KINDS.get(_topic(found, topics))):
                    if kind is Snapshot:
                        _refuse_other_format(path, found.data)
                    message = DECODERS[kind].decode(found.data)
                    joints = _joints_of(message, joints)
                    if isinstance(message, State):
                        states += 1
                        last = str(message.tick)
                        if states % PROGRESS_STATES == 0:
                            progress(stream.tell() / size)
                    yield message
        except BrokenError as error:
            raise LogError(f"{path} {error}: {states} states read, last tick {last}") from error
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise LogError(f"{path} is of another version after tick {last}: {error}") from error


def holds_a_state(path: Path) -> bool:
    """True if a State can be read from a recording, whole or not."""
    try:
        return any(isinstance(message, State) for message in read_log(path))
    except LogError:
        return False


def _joints_of(message: Snapshot | State, before: int) -> int:
    """Number of joints from a message on. Raises BrokenError for a State with another number, or
    without a Snapshot before it, and for a joint's name that would upset a terminal."""
    if isinstance(message, Snapshot):
        if odd := [name for name in message.joints if not name or name != printable(name)]:
            raise BrokenError(f"is damaged: {odd[0]!r} is no name of a joint")
        return len(message.joints)
    for field in PER_JOINT:
        values = getattr(message, field)
        if values is not None and len(values) != before:
            raise BrokenError(
                f"is damaged in tick {message.tick}: {len(values)} values of {field} for {before} "
                "joints"
            )
    return before


def _refuse_other_format(path: Path, snapshot: bytes) -> None:
    if refusal := format_refusal(msgspec.json.decode(snapshot, type=_Format).format):
        raise LogError(f"{path} is a recording {refusal}")


def _topic(message: Message, topics: Mapping[int, str]) -> str:
    """Topic of a message. Raises BrokenError if it names a channel that does not exist."""
    if message.channel_id not in topics:
        raise BrokenError(f"is damaged: no channel {message.channel_id}")
    return topics[message.channel_id]


class BrokenError(Exception):
    """Damage of a file; `read_log` adds how far it was read."""


def mcap_records(path: Path, stream: IO[bytes], *, ours: bool = True) -> Iterator[Any]:
    """Records of an MCAP file, one of contactd unless it need not be `ours`.

    Every failure of the library becomes a BrokenError; LogError where it is no such file.
    """
    begin = stream.read(len(MAGIC))
    if not begin:
        raise LogError(f"{path} is empty")
    if begin != MAGIC:
        raise LogError(f"{path} is not an MCAP file")
    size = path.stat().st_size
    stream.seek(0)
    reader = StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT_BYTES)
    records = reader.records
    while True:
        try:
            found = next(records)
        except StopIteration:
            return
        except Exception as error:  # garbage makes the library raise nearly anything
            if stream.tell() >= size:
                raise BrokenError("ends in the middle") from error
            raise BrokenError(f"is damaged ({error})") from error
        if ours and isinstance(found, Header) and found.profile != PROFILE:
            raise LogError(f"{path} is an MCAP file, but not a recording of contactd")
        yield found
