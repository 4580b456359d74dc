"""Connection for asyncio: like `contactd_client.connection`, with `await`."""

import asyncio
import contextlib
import socket
from pathlib import Path
from typing import Self

from contactd_client.connection import ANSWER_S, MAX_PACKET_BYTES
from contactd_client.errors import ClosedError, UnreachableError
from contactd_client.paths import why_unreachable

_RETRY_S = 0.001  # retry interval if the daemon's backlog is full
_buffer = bytearray(MAX_PACKET_BYTES)  # shared: there is no await between receiving and copying


class AsyncConnection:
    """One connection, from `open` to `close`. Every method raises UnreachableError if there is no
    daemon, or it does not answer in time."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected

    @classmethod
    async def open(cls, path: Path, timeout_s: float = ANSWER_S) -> Self:
        """Connect to the socket at `path`."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        with contextlib.ExitStack() as opened:
            opened.callback(connection.close)
            try:
                async with asyncio.timeout(timeout_s):
                    await _connect(connection, path)
            except OSError as error:
                raise UnreachableError(why_unreachable(path, error)) from error
            opened.pop_all()
        return cls(connection)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    async def exchange(self, request: bytes, timeout_s: float) -> bytes:
        """Send a request and wait for its answer, at most `timeout_s` [s]. After a timeout the
        connection is closed: a late answer would be mistaken for that to the next request."""
        if self._socket.fileno() < 0:
            raise UnreachableError("the daemon has ended or was silent: connect again")
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                # The daemon may have sent a reason before it closed: read on.
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    await loop.sock_sendall(self._socket, request)
                return await self._receive()
        except TimeoutError:
            self.close()
            raise UnreachableError("the daemon does not answer") from None
        except BaseException:
            self.close()
            raise

    async def send(self, request: bytes, timeout_s: float) -> None:
        """Send a request whose answer is read later."""
        try:
            async with asyncio.timeout(timeout_s):
                await asyncio.get_running_loop().sock_sendall(self._socket, request)
        except TimeoutError:
            raise UnreachableError("the daemon is silent: it reads no requests") from None
        except OSError as error:
            raise _gone(error) from error

    async def packet(self, timeout_s: float) -> bytes:
        """Next message, undecoded, within `timeout_s` [s]."""
        try:
            async with asyncio.timeout(timeout_s):
                return await self._receive()
        except TimeoutError:
            raise UnreachableError("the daemon fell silent") from None

    def waiting(self) -> list[bytes]:
        """Packets already received, in order, without blocking. Raises UnreachableError after the
        last one if the daemon is gone."""
        packets: list[bytes] = []
        while True:
            try:
                size = self._socket.recv_into(_buffer)
            except BlockingIOError:
                return packets
            except OSError as error:
                raise _gone(error) from error
            if not size and packets:
                return packets  # the next call reports the end
            if not size:
                raise ClosedError("the daemon closed the connection")
            packets.append(bytes(memoryview(_buffer)[:size]))

    async def _receive(self) -> bytes:
        loop = asyncio.get_running_loop()
        try:
            try:
                packet = await loop.sock_recv(self._socket, MAX_PACKET_BYTES)
            except ConnectionResetError:
                # Raised once, ahead of messages that the daemon sent before it closed.
                packet = await loop.sock_recv(self._socket, MAX_PACKET_BYTES)
        except OSError as error:
            raise _gone(error) from error
        if not packet:
            raise ClosedError("the daemon closed the connection")
        return packet


async def _connect(connection: socket.socket, path: Path) -> None:
    """Connect, with retries while the daemon's backlog is full."""
    while True:
        try:
            return connection.connect(str(path))
        except BlockingIOError:
            await asyncio.sleep(_RETRY_S)


def _gone(error: OSError) -> UnreachableError:
    return UnreachableError(f"the daemon is gone: {error.strerror or error}")
