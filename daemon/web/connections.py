"""Bounded connections: so many in all and by address, none that stays longer than a request takes.

asyncio hands each accepted connection to a protocol; this one stands before aiohttp's. Each carries
one request and is closed. So who sends half a head, half a body, or reads no answer holds a place
for so long and no longer; and a command never goes into a connection that was lost long ago, as it
is when a phone changes its network.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Final

from daemon.web.guard import Places

REQUEST_S: Final = 30.0  # from connecting to the end of the answer: the page over a very slow radio
# Of answers that wait in the kernel: it would keep megabytes for a browser that does not read.
SEND_BUFFER_BYTES: Final = 1 << 16


class BoundedConnection(asyncio.Protocol):
    """Protocol that passes everything on to `inner`, if there is a place for its connection."""

    def __init__(self, inner: asyncio.Protocol, places: Places) -> None:
        self._inner, self._places = inner, places
        self._address: str | None = None  # None: it has no place
        self._end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place, or hang up."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername")
        address = peer[0] if isinstance(peer, tuple) else ""  # all that come through a unix socket
        if not self._places.take(address):
            transport.abort()
            return
        self._address = address
        connected = transport.get_extra_info("socket")
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._end = asyncio.get_running_loop().call_later(REQUEST_S, transport.abort)
        self._inner.connection_made(transport)

    def stay(self) -> None:
        """Have no end but its own: a stream, or a large file."""
        if self._end is not None:
            self._end.cancel()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        if self._address is None:
            return
        self._places.leave(self._address)
        self.stay()
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Pass it on."""
        if self._address is not None:
            self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """Pass it on."""
        return None if self._address is None else self._inner.eof_received()

    def pause_writing(self) -> None:
        """Pass it on."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        self._inner.resume_writing()


def stay(transport: asyncio.BaseTransport | None) -> None:
    """Let a connection last longer than a request takes."""
    protocol = transport.get_protocol() if transport is not None else None
    if isinstance(protocol, BoundedConnection):
        protocol.stay()


def bounded(
    make: Callable[[], asyncio.Protocol], places: Places
) -> Callable[[], BoundedConnection]:
    """Factory of bounded connections around those that `make` makes."""
    return lambda: BoundedConnection(make(), places)
