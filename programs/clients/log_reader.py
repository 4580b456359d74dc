"""Reader of MCAP recordings: records, snapshots and States, also of damaged files."""

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, get_type_hints

import msgspec
from mcap.records import Channel, Header, Message
from mcap.stream_reader import StreamReader

from common.errors import LogError
from common.regular_file import open_regular
from daemon.protocol.state import PerJoint, Snapshot, State, format_refusal
from daemon.protocol.strict_json import StrictDecoder
from daemon.protocol.text import printable

# Fields of a State with one entry per joint.
PER_JOINT = (
    "fresh",
    "drives",
    "side",
    *(name for name, kind in get_type_hints(State).items() if kind in (PerJoint, PerJoint | None)),
)
PROFILE = "contactd"

KINDS: dict[str, type[Snapshot] | type[State]] = {"/snapshot": Snapshot, "/state": State}


DECODERS: dict[type[Snapshot] | type[State], StrictDecoder[Any]] = {
    kind: StrictDecoder(kind) for kind in KINDS.values()
}
MAGIC = b"\x89MCAP0\r\n"
PROGRESS_STATES = 1024  # States between two reports of progress
BATCH = 32  # States per batch; larger ones would not fit into the processor's cache
RECORD_LIMIT_BYTES = 64 << 20  # keeps a damaged length from claiming all memory


class _Format(msgspec.Struct):
    """Version of a Snapshot, read before its other fields."""

    format: int = 0


def read_log(
    path: Path, progress: Callable[[float], None] = lambda share: None
) -> Iterator[Snapshot | State]:
    """Messages of a recording in order; `progress` is called from time to time with the share of
    the file that was read.

    Raises LogError if `path` cannot be read, is no MCAP file, is no recording of contactd, has an
    unsupported format, or is damaged; all intact messages of a truncated file come first.
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
        except DamagedFileError as error:
            raise LogError(f"{path} {error}: {states} states read, last tick {last}") from error
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise LogError(f"{path} is of another version after tick {last}: {error}") from error


def batches(
    path: Path, progress: Callable[[float], None] = lambda share: None
) -> Iterator[Snapshot | list[State]]:
    """Snapshots of a recording, and the States between them in batches.

    Raises LogError as `read_log` does, after all intact messages.
    """
    states: list[State] = []
    broken: LogError | None = None
    try:
        for message in read_log(path, progress):
            if isinstance(message, State):
                states.append(message)
            if states and (message is not states[-1] or len(states) == BATCH):
                yield states
                states = []
            if isinstance(message, Snapshot):
                yield message
    except LogError as error:
        broken = error
    if states:
        yield states
    if broken is not None:
        raise broken


def read_batches(
    path: Path,
    take: Callable[[Snapshot | list[State]], None],
    progress: Callable[[float], None] = lambda share: None,
) -> str:
    """Pass all `batches` of a recording to `take`; returns why the recording ends early, or empty.
    Raises LogError if it has no State."""
    taken = False
    try:
        for batch in batches(path, progress):
            take(batch)
            taken = taken or not isinstance(batch, Snapshot)
    except LogError as error:
        if not taken:
            raise
        return str(error)
    if not taken:
        raise LogError(f"{path} is a recording without any state")
    return ""


def holds_a_state(path: Path) -> bool:
    """True if at least one State can be read from a recording, even a damaged one."""
    try:
        return any(isinstance(message, State) for message in read_log(path))
    except LogError:
        return False


def _joints_of(message: Snapshot | State, before: int) -> int:
    """Number of joints after a message. Raises DamagedFileError for a State with another number of
    values, and for a joint's name that is not printable."""
    if isinstance(message, Snapshot):
        if odd := [name for name in message.joints if not name or name != printable(name)]:
            raise DamagedFileError(f"is damaged: {odd[0]!r} is no joint name")
        return len(message.joints)
    for field in PER_JOINT:
        values = getattr(message, field)
        if values is not None and len(values) != before:
            raise DamagedFileError(
                f"is damaged in tick {message.tick}: {len(values)} values of {field} for {before} "
                "joints"
            )
    return before


def _refuse_other_format(path: Path, snapshot: bytes) -> None:
    if refusal := format_refusal(msgspec.json.decode(snapshot, type=_Format).format):
        raise LogError(f"{path} is a recording {refusal}")


def _topic(message: Message, topics: Mapping[int, str]) -> str:
    """Topic of a message. Raises DamagedFileError for an unknown channel."""
    if message.channel_id not in topics:
        raise DamagedFileError(f"is damaged: no channel {message.channel_id}")
    return topics[message.channel_id]


class DamagedFileError(Exception):
    """Error of a damaged file; `read_log` adds how far it was read."""


def mcap_records(path: Path, stream: IO[bytes], *, ours: bool = True) -> Iterator[Any]:
    """Records of an MCAP file; with `ours`, only of a recording of contactd.

    Raises DamagedFileError for any failure of the library, LogError if it is no such file.
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
        except Exception as error:  # the library raises nearly any exception on garbage
            if stream.tell() >= size:
                raise DamagedFileError("ends in the middle") from error
            raise DamagedFileError(f"is damaged ({error})") from error
        if ours and isinstance(found, Header) and found.profile != PROFILE:
            raise LogError(f"{path} is an MCAP file, but not a recording of contactd")
        yield found
