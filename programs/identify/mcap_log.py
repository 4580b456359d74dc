"""Logs of other programs as MCAP files: one topic of JSON messages, as rows of numbers by field.

A field is named by its way through a message: `effort`, `position[2]`, `joints.elbow.angle`; `time`
is when the message was logged [s]. What is encoded otherwise (ROS 2's CDR, protobuf) is refused:
a CSV holds it as well.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Message

from common.errors import LogError
from common.regular_file import open_regular
from daemon.protocol.text import printable
from programs.clients.log_reader import BrokenError, mcap_records

TIME = "time"


def read_rows(path: Path, topic: str) -> tuple[list[str], Iterator[tuple[int, list[float]]]]:
    """Fields of a topic's first message that are numbers, and the rows: the message's number and
    its values in that order. Raises LogError, also while rows are read."""
    messages = _messages(path, topic)
    first = next(messages, None)
    if first is None:
        raise LogError(f"{path}: there are no messages of {printable(topic)} in it")
    header = list(first)

    def rows() -> Iterator[tuple[int, list[float]]]:
        yield 1, list(first.values())
        for number, message in enumerate(messages, start=2):
            if missing := [name for name in header if name not in message]:
                raise LogError(f"{path}: message {number} of {printable(topic)} has no number "
                               f"{printable(missing[0])}")  # fmt: skip
            yield number, [message[name] for name in header]

    return header, rows()


def _messages(path: Path, topic: str) -> Iterator[dict[str, float]]:
    try:
        stream = open_regular(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    channels: dict[int, Channel] = {}
    with stream:
        try:
            for found in mcap_records(path, stream, ours=False):
                if isinstance(found, Channel):
                    channels[found.id] = found
                elif isinstance(found, Message):
                    channel = channels.get(found.channel_id)
                    if channel is not None and channel.topic == topic:
                        yield _numbers(path, channel, found)
        except BrokenError as error:
            raise LogError(f"{path} {error}") from error
    if channels and topic not in (known := [c.topic for c in channels.values()]):
        there = printable(", ".join(sorted(set(known)))[:200])
        raise LogError(f"{path}: no topic {printable(topic)}; there are {there}")


def _numbers(path: Path, channel: Channel, message: Message) -> dict[str, float]:
    topic = printable(channel.topic)
    if channel.message_encoding != "json":
        raise LogError(f"{path}: {topic} is encoded as {printable(channel.message_encoding)}; only "
                       "json can be read: export it as a CSV")  # fmt: skip
    try:
        content = msgspec.json.decode(message.data)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: a message of {topic} is no JSON: {error}") from error
    return {TIME: 1e-9 * message.log_time} | dict(_flat("", content))


def _flat(name: str, content: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message, by their way through it."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _flat(f"{name}.{key}" if name else key, value)
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from _flat(f"{name}[{k}]", value)
    elif isinstance(content, (int, float)) and not isinstance(content, bool):
        yield name, float(content)
