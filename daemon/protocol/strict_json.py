"""Strict JSON: messages of a known type, in which no object has a key twice.

msgspec silently takes the last of two equal keys, other readers the first: an ambiguous request
must not be carried out, and a recording must not be ambiguous.
"""

import contextlib
import json
import re
from typing import Any, Final, Generic, TypeVar

import msgspec

T = TypeVar("T")
_PLACE: Final = re.compile(r" - at `\$((?:\.\w+)+)`$")
_SHOWN_BYTES: Final = 60


class StrictDecoder(Generic[T]):
    """Decoder of JSON objects of type T, a struct or a union of them: `kind`."""

    def __init__(self, kind: Any) -> None:
        self._decoder = msgspec.json.Decoder(kind)
        self._encoder = msgspec.json.Encoder()

    def decode(self, packet: bytes) -> T:
        """Decoded object. Raises msgspec.DecodeError for anything else, invalid UTF-8, or a
        duplicate key."""
        try:
            found: T = self._decoder.decode(packet)
            # Messages of our own programs re-encode byte for byte, so no key was dropped.
            if self._encoder.encode(found) != packet:
                _STRICT.decode(packet.decode())
        except msgspec.ValidationError as error:
            with contextlib.suppress(json.JSONDecodeError, UnicodeDecodeError, RecursionError):
                _STRICT.decode(packet.decode())
            raise msgspec.ValidationError(f"{error}{_value_text(packet, str(error))}") from error
        except UnicodeDecodeError as error:
            raise msgspec.DecodeError(f"JSON is malformed: {error}") from error
        except RecursionError as error:
            raise msgspec.DecodeError("JSON is nested too deeply") from error
        return found


def _value_text(packet: bytes, problem: str) -> str:
    """Text of the value that caused a validation error; empty if the error names no single one."""
    place = _PLACE.search(problem)
    if place is None:
        return ""
    try:
        value = msgspec.json.decode(packet)
        for key in place[1].split(".")[1:]:
            value = value[key]
    except (msgspec.DecodeError, ValueError, RecursionError, LookupError, TypeError):
        return ""  # the error is elsewhere in it
    return f", not {msgspec.json.encode(value)[:_SHOWN_BYTES].decode(errors='replace')}"


def _unique_keys(pairs: list[tuple[str, Any]]) -> None:
    seen: set[str] = set()
    for key, _ in pairs:
        if key in seen:
            raise msgspec.DecodeError(f"key `{key[:40]}` is given twice")
        seen.add(key)


_STRICT = json.JSONDecoder(object_pairs_hook=_unique_keys)
