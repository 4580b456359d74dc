"""Reader of other programs' MCAP files: messages of one topic as rows of numbers by field.

A field is named by its path in a message: `effort`, `position[2]`, `joints.elbow.angle`; if the
message names its elements, `position.elbow` (ROS 2's JointState) or `joints.elbow.position`
(Foxglove's JointStates). `time` is the message's stamp, or else its log time [s]. JSON is decoded
directly, protobuf and ROS 2's CDR by the libraries of the extra `logs`.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from mcap.decoder import DecoderFactory
from mcap.records import Channel, Message, Schema
from numpy.typing import NDArray

from common.arrays import Matrix
from common.errors import LogError
from common.regular_file import open_regular
from daemon.protocol.text import printable
from programs.clients.log_reader import DamagedFileError, mcap_records

TIME: Final = "time"
_FIRST: Final = 100  # messages that define a topic's fields, as several programs may publish it
_SECONDS: Final = ({"sec", "nanosec"}, {"seconds", "nanos"})
_STAMPS: Final = ("header.stamp", "timestamp")
_EXTRA: Final = "pip install 'contactd[logs]'"


def read_rows(path: Path, topic: str) -> tuple[list[str], Iterator[tuple[int, list[float]]]]:
    """Numeric fields of a topic, and an iterator of rows: message number and values in that order,
    NaN for a missing field. Raises LogError, also while rows are read."""
    messages = _messages(path, topic)
    first = list(itertools.islice(messages, _FIRST))
    if not first:
        raise LogError(f"{path}: it contains no messages of {printable(topic)}")
    header = list(dict.fromkeys(itertools.chain.from_iterable(first)))
    rows = ([message.get(name, float("nan")) for name in header]
            for message in itertools.chain(first, messages))  # fmt: skip
    return header, enumerate(rows, start=1)


def of_one_sender(
    path: Path, table: Matrix, columns: Sequence[str], stamp: int
) -> NDArray[np.bool_]:
    """Mask (N,) of rows of a table (N, k) without those of other senders, which have no column but
    `stamp`. Raises LogError for a row that has only some of the columns."""
    lacking = np.isnan(table)
    others = np.asarray(np.delete(lacking, stamp, axis=1).all(axis=1))
    if (short := lacking.any(axis=1) & ~others).any():
        number = int(np.argmax(short))
        lacks = columns[int(np.argmax(lacking[number]))]
        raise LogError(f"{path}: message {number + 1} has no number {printable(lacks)}")
    return ~others


def headers(path: Path) -> dict[str, list[str]]:
    """Fields of each readable topic of a file. Raises LogError if none is readable."""
    known = dict.fromkeys(one.topic for one in _records(path) if isinstance(one, Channel))
    found: dict[str, list[str]] = {}
    why: LogError | None = None
    for topic in known:
        try:
            found[topic] = read_rows(path, topic)[0]
        except LogError as error:
            why = error
    if why and not found:
        raise why
    return found


def _records(path: Path) -> Iterator[Any]:
    try:
        stream = open_regular(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    with stream:
        try:
            yield from mcap_records(path, stream, ours=False)
        except DamagedFileError as error:
            raise LogError(f"{path} {error}") from error


def _messages(path: Path, topic: str) -> Iterator[dict[str, float]]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    decoders: dict[int, Callable[[bytes], Any]] = {}
    for found in _records(path):
        if isinstance(found, Schema):
            schemas[found.id] = found
        elif isinstance(found, Channel):
            channels[found.id] = found
        elif isinstance(found, Message):
            channel = channels.get(found.channel_id)
            if channel is None or channel.topic != topic:
                continue
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(path, channel, schemas.get(channel.schema_id))
            try:
                content = decoders[channel.id](found.data)
            except Exception as error:  # any library's exception on damaged bytes
                raise LogError(f"{path}: a message of {printable(topic)} is no "
                               f"{channel.message_encoding}: {error}") from error  # fmt: skip
            yield {TIME: 1e-9 * found.log_time} | dict(_flat("", content))
    if channels and topic not in (known := [c.topic for c in channels.values()]):
        there = printable(", ".join(sorted(set(known)))[:200])
        raise LogError(f"{path}: no topic {printable(topic)}; there are {there}")


def _decoder(path: Path, channel: Channel, schema: Schema | None) -> Callable[[bytes], Any]:
    """Decoder of a channel's messages. Raises LogError if there is none."""
    encoding, topic = channel.message_encoding, printable(channel.topic)
    if encoding == "json":
        return msgspec.json.decode
    try:
        factories = _factories()
    except ImportError as error:
        raise LogError(f"{path}: {topic} is encoded as {printable(encoding)}: {_EXTRA} reads "
                       "protobuf and cdr; or export it as a CSV") from error  # fmt: skip
    try:
        for factory in factories:
            if decoder := factory.decoder_for(encoding, schema):
                return decoder
    except Exception as error:  # any library's exception on an invalid schema
        raise LogError(f"{path}: the schema of {topic} cannot be read: {error}") from error
    by = f"{printable(encoding)} by {printable(schema.encoding) if schema else 'no schema'}"
    raise LogError(f"{path}: {topic} is encoded as {by}; json, protobuf, and cdr by ros2msg can be "
                   "read: export it as a CSV")  # fmt: skip


def _factories() -> tuple[DecoderFactory, ...]:
    """Decoder factories, new for each file, as they cache schemas by IDs that differ by file."""
    import mcap_protobuf.decoder  # noqa: PLC0415 - of an extra
    import mcap_ros2.decoder  # noqa: PLC0415

    return mcap_protobuf.decoder.DecoderFactory(), mcap_ros2.decoder.DecoderFactory()


def _flat(name: str, content: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message by their path in it."""
    if isinstance(content, (int, float)):
        if not isinstance(content, bool):
            yield name, float(content)
    elif isinstance(content, str | bytes):
        return
    elif (fields := _fields(content)) is not None:
        if fields.keys() in _SECONDS:
            stamp = fields.values()
            if any(stamp):  # a stamp of zeros was never set
                whole, parts = stamp
                yield TIME if name in _STAMPS else name, whole + 1e-9 * parts
            return
        names = [one for one in _elements(fields.get("name")) if isinstance(one, str)]
        for key, value in fields.items():
            path = f"{name}.{key}" if name else key
            if names and len(elements := _elements(value)) == len(names):
                for one, element in zip(names, elements, strict=True):
                    yield from _flat(f"{path}.{one}", element)
            else:
                yield from _flat(path, value)
    else:
        for k, value in enumerate(_elements(content)):
            own = (_fields(value) or {}).get("name")
            yield from _flat(f"{name}.{own}" if own else f"{name}[{k}]", value)


def _fields(content: Any) -> dict[str, Any] | None:
    """Fields, by name, of a message decoded by any library; None for anything else."""
    if isinstance(content, dict):
        return content
    if hasattr(content, "DESCRIPTOR"):
        return {field.name: getattr(content, field.name) for field in content.DESCRIPTOR.fields}
    if hasattr(content, "__slots__") and hasattr(content, "_type"):
        return {field: getattr(content, field) for field in content.__slots__}
    return None


def _elements(content: Any) -> list[Any]:
    """Elements of a list type of any library; empty for anything else."""
    listed = isinstance(content, Iterable) and not isinstance(content, str | bytes | dict)
    return list(content) if listed else []
