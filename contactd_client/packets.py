"""Encoding of requests, and decoding of answers and States, as JSON packets. Pure."""

import json
from collections.abc import Callable
from typing import Any, Final, cast

from contactd_client.errors import ControlError
from contactd_client.messages import STATE_FORMAT, Reply, Request, Snapshot, State, Status

_MOST_SHOWN: Final = 40  # characters of an invalid value
#: Checks of fields that this client evaluates.
_SHAPES: Final[dict[str, Callable[[Any], bool]]] = {
    "ok": lambda value: isinstance(value, bool),
    "message": lambda value: isinstance(value, str),
    "reasons": lambda value: (
        isinstance(value, list) and all(isinstance(reason, str) for reason in value)
    ),
    "status": lambda value: value is None or isinstance(value, dict),
    "snapshot": lambda value: value is None or isinstance(value, dict),
}


def encode(request: Request) -> bytes:
    """Packet of a request. Raises ControlError if it cannot be encoded as JSON."""
    try:
        return json.dumps(request, separators=(",", ":"), allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise ControlError(f"no request: {error}") from error


def decode_reply(packet: bytes) -> Reply:
    """Answer in a packet. Raises ControlError if it is invalid."""
    message = _decode(packet, "ok")
    for key, is_right in _SHAPES.items():
        if key in message and not is_right(message[key]):
            shown = repr(message[key])[:_MOST_SHOWN]
            raise ControlError(f"the daemon speaks another version: its `{key}` is {shown}")
    return cast(Reply, message)


def decode_state(packet: bytes) -> State:
    """State in a packet. Raises ControlError if it is invalid."""
    return cast(State, _decode(packet, "tick"))


def refusal(reply: Reply) -> str:
    """Message and all reasons of a refusal, in one line."""
    return "; ".join([reply.get("message") or "refused", *reply.get("reasons", [])])


def status_of(reply: Reply) -> Status:
    """Status in the answer to `status`. Raises ControlError for a refusal."""
    status = reply.get("status")
    if status is None:
        raise ControlError(refusal(reply))
    return status


def snapshot_of(reply: Reply) -> Snapshot:
    """Snapshot in the answer to `subscribe`. Raises ControlError for a refusal, or if the format of
    the States differs from that of this client."""
    snapshot = reply.get("snapshot")
    if snapshot is None:
        raise ControlError(refusal(reply))
    version = snapshot.get("format", 0)
    if version != STATE_FORMAT:
        raise ControlError(
            f"the daemon's States are of format {version}, this client reads {STATE_FORMAT}: use "
            "the client of the daemon's version of contactd"
        )
    return snapshot


def _decode(packet: bytes, key: str) -> Any:
    try:
        message = json.loads(packet)
    except (ValueError, RecursionError) as error:
        raise ControlError(f"the daemon speaks another version: {error}") from error
    if not isinstance(message, dict) or key not in message:
        raise ControlError(f"the daemon speaks another version: no `{key}` in its message")
    return message
