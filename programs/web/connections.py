"""Bounded connections: limits on their number, in total and by address, and on their duration.

asyncio passes each accepted connection to a protocol; this one wraps aiohttp's. Each connection
carries one request and is closed. An incomplete head or body, or an answer that is not read, thus
occupies a place for a limited time only; and a command is never sent into a connection that was
lost long ago, e.g. when a phone changed networks.

If an address has no place left, its oldest connection is dropped, unless it carries a stream or a
command: all users of one computer share an address, and idle connections must not keep a page from
stopping the arm.
"""

import asyncio
import contextlib
import socket
from collections.abc import Callable, Iterator
from typing import Final

from programs.web.guard import Places

HEAD_S: Final = 5.0  # timeout from connecting to the complete head of the request
REQUEST_S: Final = 30.0  # timeout from there to the end of the answer, for very slow radio links
# Limits the kernel's send buffer, which could hold megabytes for a browser that does not read.
SEND_BUFFER_BYTES: Final = 1 << 16


class ConnectionLimiter:
    """Connections that occupy places, and those of them that may be dropped, oldest first."""

    def __init__(self, places: Places) -> None:
        self._places = places
        self._movable: dict[BoundedConnection, str] = {}

    def enter(self, connection: "BoundedConnection", address: str) -> bool:
        """Take a place for a new connection, if necessary by dropping another; False if full."""
        while not self._places.take(address):
            other = self._makes_room(address)
            if other is None:
                return False
            other.abort()
        self._movable[connection] = address
        return True

    def _makes_room(self, address: str) -> "BoundedConnection | None":
        own = (one for one, where in self._movable.items() if where == address)
        anyone = iter(self._movable if self._places.may_have_more(address) else ())
        return next(own, next(anyone, None))

    def leave(self, connection: "BoundedConnection", address: str) -> None:
        """Give a place back."""
        self._movable.pop(connection, None)
        self._places.leave(address)

    def keep(self, connection: "BoundedConnection") -> None:
        """Protect a connection from being dropped."""
        self._movable.pop(connection, None)

    def release(self, connection: "BoundedConnection", address: str) -> None:
        """Allow a connection to be dropped again, as the newest."""
        self._movable[connection] = address


class BoundedConnection(asyncio.Protocol):
    """Protocol that forwards everything to `inner` while its connection has a place."""

    def __init__(self, inner: asyncio.Protocol, limiter: ConnectionLimiter) -> None:
        self._inner, self._limiter = inner, limiter
        self._transport: asyncio.Transport | None = None  # None if it never had a place
        self._address: str | None = None  # None if it has no place
        self._end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place, or abort."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername")
        address = peer[0] if isinstance(peer, tuple) else ""  # empty for unix sockets
        if not self._limiter.enter(self, address):
            transport.abort()
            return
        self._transport, self._address = transport, address
        connected = transport.get_extra_info("socket")
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._end_in(HEAD_S)
        self._inner.connection_made(transport)

    def _end_in(self, seconds: float) -> None:
        assert self._transport is not None
        self.stay()
        self._end = asyncio.get_running_loop().call_later(seconds, self._transport.abort)

    def asked(self) -> None:
        """Start the timeout of the request, whose head is complete."""
        if self._address is not None:
            self._end_in(REQUEST_S)

    def stay(self) -> None:
        """Cancel the timeout, for a stream or a large file."""
        if self._end is not None:
            self._end.cancel()

    def keep(self) -> None:
        """Protect the connection from being dropped."""
        if self._address is not None:
            self._limiter.keep(self)

    def release(self) -> None:
        """Allow the connection to be dropped again."""
        if self._address is not None:
            self._limiter.release(self, self._address)

    def abort(self) -> None:
        """Give the place back and abort the connection."""
        if self._address is None or self._transport is None:
            return
        self._limiter.leave(self, self._address)
        self._address = None
        self._transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        if self._transport is None:
            return
        if self._address is not None:
            self._limiter.leave(self, self._address)
            self._address = None
        self.stay()
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Forward data."""
        if self._address is not None:
            self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """Forward the end of the data."""
        return None if self._address is None else self._inner.eof_received()

    def pause_writing(self) -> None:
        """Forward the signal."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Forward the signal."""
        self._inner.resume_writing()


def _bounded(transport: asyncio.BaseTransport | None) -> BoundedConnection | None:
    protocol = transport.get_protocol() if transport is not None else None
    return protocol if isinstance(protocol, BoundedConnection) else None


def asked(transport: asyncio.BaseTransport | None) -> None:
    """Start the request timeout of a connection whose request head is complete."""
    if connection := _bounded(transport):
        connection.asked()


def stay(transport: asyncio.BaseTransport | None) -> None:
    """Let a connection last longer than the request timeout."""
    if connection := _bounded(transport):
        connection.stay()


@contextlib.contextmanager
def kept(transport: asyncio.BaseTransport | None) -> Iterator[None]:
    """Context in which a connection is not dropped for others."""
    connection = _bounded(transport)
    if connection:
        connection.keep()
    try:
        yield
    finally:
        if connection:
            connection.release()


def bounded(
    make: Callable[[], asyncio.Protocol], places: Places
) -> Callable[[], BoundedConnection]:
    """Factory of bounded connections around protocols made by `make`."""
    limiter = ConnectionLimiter(places)
    return lambda: BoundedConnection(make(), limiter)
