"""Logs of other programs as MCAP files: the messages of one topic, as rows of numbers by field.

A field is named by its way through a message: `effort`, `position[2]`, `joints.elbow.angle`; of a
message that names its elements, `position.elbow` (ROS 2's JointState) or `joints.elbow.position`
(Foxglove's JointStates). `time` is a message's stamp, or when it was logged [s]. JSON is read as it
is, protobuf and ROS 2's CDR by the libraries of the extra `logs`.
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
from programs.clients.log_reader import BrokenError, mcap_records

TIME: Final = "time"
_FIRST: Final = 100  # messages, whose fields are those of the topic: several programs may send it
_SECONDS: Final = ({"sec", "nanosec"}, {"seconds", "nanos"})
_STAMPS: Final = ("header.stamp", "timestamp")
_EXTRA: Final = "pip install 'contactd[logs]'"


def read_rows(path: Path, topic: str) -> tuple[list[str], Iterator[tuple[int, list[float]]]]:
    """Fields of a topic that are numbers, and the rows: the message's number and its values in that
    order, NaN where it lacks one. Raises LogError, also while rows are read."""
    messages = _messages(path, topic)
    first = list(itertools.islice(messages, _FIRST))
    if not first:
        raise LogError(f"{path}: there are no messages of {printable(topic)} in it")
    header = list(dict.fromkeys(itertools.chain.from_iterable(first)))
    rows = ([message.get(name, float("nan")) for name in header]
            for message in itertools.chain(first, messages))  # fmt: skip
    return header, enumerate(rows, start=1)


def of_one_sender(
    path: Path, table: Matrix, columns: Sequence[str], stamp: int
) -> NDArray[np.bool_]:
    """Rows (N,) of a table (N, k) of these columns that are not of other senders, which have none
    of them but `stamp`. Raises LogError for a row that lacks one."""
    lacking = np.isnan(table)
    others = np.asarray(np.delete(lacking, stamp, axis=1).all(axis=1))
    if (short := lacking.any(axis=1) & ~others).any():
        number = int(np.argmax(short))
        lacks = columns[int(np.argmax(lacking[number]))]
        raise LogError(f"{path}: message {number + 1} has no number {printable(lacks)}")
    return ~others


def headers(path: Path) -> dict[str, list[str]]:
    """Fields of each topic of a file that can be read. Raises LogError where none can be."""
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
        except BrokenError as error:
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
            except Exception as error:  # of whichever library, of damaged bytes
                raise LogError(f"{path}: a message of {printable(topic)} is no "
                               f"{channel.message_encoding}: {error}") from error  # fmt: skip
            yield {TIME: 1e-9 * found.log_time} | dict(_flat("", content))
    if channels and topic not in (known := [c.topic for c in channels.values()]):
        there = printable(", ".join(sorted(set(known)))[:200])
        raise LogError(f"{path}: no topic {printable(topic)}; there are {there}")


def _decoder(path: Path, channel: Channel, schema: Schema | None) -> Callable[[bytes], Any]:
    """Reader of a channel's messages. Raises LogError where none reads them."""
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
    except Exception as error:  # of a schema that no library makes sense of
        raise LogError(f"{path}: the schema of {topic} cannot be read: {error}") from error
    by = f"{printable(encoding)} by {printable(schema.encoding) if schema else 'no schema'}"
    raise LogError(f"{path}: {topic} is encoded as {by}; json, protobuf, and cdr by ros2msg can be "
                   "read: export it as a CSV")  # fmt: skip


def _factories() -> tuple[DecoderFactory, ...]:
    """New ones: they keep schemas by numbers that another file gives to others."""
    import mcap_protobuf.decoder  # noqa: PLC0415 - of an extra
    import mcap_ros2.decoder  # noqa: PLC0415

    return mcap_protobuf.decoder.DecoderFactory(), mcap_ros2.decoder.DecoderFactory()


def _flat(name: str, content: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message, by their way through it."""
    if isinstance(content, (int, float)):
        if not isinstance(content, bool):
            yield name, float(content)
    elif isinstance(content, str | bytes):
        return
    elif (fields := _fields(content)) is not None:
        if fields.keys() in _SECONDS:
            stamp = fields.values()
            if any(stamp):  # not one that was never set
                whole, parts = stamp
                yield TIME if name in _STAMPS else name, whole + 1e-9 * parts
            return
        names = [one for one in _elements(fields.get("name")) if isinstance(one, str)]
        for key, value in fields.items():
            way = f"{name}.{key}" if name else key
            if names and len(elements := _elements(value)) == len(names):
                for one, element in zip(names, elements, strict=True):
                    yield from _flat(f"{way}.{one}", element)
            else:
                yield from _flat(way, value)
    else:
        for k, value in enumerate(_elements(content)):
            own = (_fields(value) or {}).get("name")
            yield from _flat(f"{name}.{own}" if own else f"{name}[{k}]", value)


def _fields(content: Any) -> dict[str, Any] | None:
    """Fields of a message of any library by name; None of what is no message."""
    if isinstance(content, dict):
        return content
    if hasattr(content, "DESCRIPTOR"):
        return {field.name: getattr(content, field.name) for field in content.DESCRIPTOR.fields}
    if hasattr(content, "__slots__") and hasattr(content, "_type"):
        return {field: getattr(content, field) for field in content.__slots__}
    return None


def _elements(content: Any) -> list[Any]:
    """Elements of a list of any library; none of anything else."""
    listed = isinstance(content, Iterable) and not isinstance(content, str | bytes | dict)
    return list(content) if listed else []
