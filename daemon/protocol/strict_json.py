"""Strict JSON: messages of a known type, in which no object has a key twice.

msgspec takes the last of two equal keys in silence, other readers the first: a request that says
two things must not be carried out, and a recording must not mean two things.
"""

import json
from typing import Any, Generic, TypeVar

import msgspec

T = TypeVar("T")


class StrictDecoder(Generic[T]):
    """Decoder of JSON objects of type `kind`."""

    def __init__(self, kind: type[T]) -> None:
        self._decoder = msgspec.json.Decoder(kind)
        self._encoder = msgspec.json.Encoder()

    def decode(self, packet: bytes) -> T:
        """The object. Raises msgspec.DecodeError for what is no such object, is not UTF-8, or has a
        key twice."""
        try:
            found = self._decoder.decode(packet)
            # What our own programs have written comes out byte for byte: nothing was dropped.
            if self._encoder.encode(found) != packet:
                _STRICT.decode(packet.decode())
        except UnicodeDecodeError as error:
            raise msgspec.DecodeError(f"JSON is malformed: {error}") from error
        except RecursionError as error:
            raise msgspec.DecodeError("JSON is nested too deeply") from error
        return found


def _once(pairs: list[tuple[str, Any]]) -> None:
    seen: set[str] = set()
    for key, _ in pairs:
        if key in seen:
            raise msgspec.DecodeError(f"key `{key[:40]}` is given twice")
        seen.add(key)


_STRICT = json.JSONDecoder(object_pairs_hook=_once)
