"""Bounded TCP connections: so many in all and by address, and none that stays without asking.

asyncio hands each accepted connection to a protocol; this one stands before aiohttp's.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from daemon.web.guard import Places

FIRST_WORD_S: Final = 10.0  # after which a connection that has asked for nothing is closed
BEHIND_PROXY: Final = ""  # address of all that come through a unix socket


class BoundedConnection(asyncio.Protocol):
    """Protocol that passes everything on to `inner`, if there is a place for its connection."""

    def __init__(self, inner: asyncio.Protocol, places: Places) -> None:
        self._inner, self._places = inner, places
        self._address: str | None = None  # None: it has no place
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place, or hang up."""
        assert isinstance(transport, asyncio.Transport)
        peer = transport.get_extra_info("peername")
        address = peer[0] if isinstance(peer, tuple) else BEHIND_PROXY
        if address != BEHIND_PROXY and not self._places.take(address):
            transport.abort()
            return
        self._address = address
        loop = asyncio.get_running_loop()
        self._patience = loop.call_later(FIRST_WORD_S, transport.abort)
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        if self._address is None:
            return
        if self._address != BEHIND_PROXY:
            self._places.leave(self._address)
        if self._patience is not None:
            self._patience.cancel()
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Pass it on; from the end of a request's head on, aiohttp watches the time."""
        if self._address is None:
            return
        if self._patience is not None and b"\r\n\r\n" in data:
            self._patience.cancel()
            self._patience = None
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


def bounded(
    make: Callable[[], asyncio.Protocol], places: Places
) -> Callable[[], BoundedConnection]:
    """Factory of bounded connections around those that `make` makes."""
    return lambda: BoundedConnection(make(), places)
