"""Connection to one daemon for asyncio: requests that are answered, and States as they come.

`clients/client.py` blocks; here one thread serves many daemons and browsers.
"""

import asyncio
import contextlib
import socket
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from daemon.clients.client import MAX_PACKET_BYTES, why_unreachable
from daemon.protocol.messages import Reply, Request
from errors import ControlError, UnreachableError

_ANSWER_S = 2.0
_THRONG_S = 0.01  # about a tick: the daemon lets in all who wait
_buffer = bytearray(MAX_PACKET_BYTES)  # nothing waits between a packet's arrival and its copy
_replies = msgspec.json.Decoder(Reply)


class Link:
    """One connection. Every method raises UnreachableError where there is no daemon, and none that
    answers in time."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected

    @classmethod
    async def open(cls, path: Path) -> Self:
        """Connect to the socket at `path`."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        with contextlib.ExitStack() as opened:
            opened.callback(connection.close)
            try:
                async with asyncio.timeout(_ANSWER_S):
                    await _connect(connection, path)
            except OSError as error:
                raise UnreachableError(why_unreachable(path, error)) from error
            opened.pop_all()
        return cls(connection)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    async def ask(self, request: Request, timeout_s: float = _ANSWER_S) -> Reply:
        """Send a request and wait for its answer, which may be a refusal. Raises ControlError for
        an answer that is not understood."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                await loop.sock_sendall(self._socket, msgspec.json.encode(request))
                packet = await loop.sock_recv(self._socket, MAX_PACKET_BYTES)
        except TimeoutError:
            raise UnreachableError("the daemon does not answer") from None
        except OSError as error:
            raise UnreachableError(f"the daemon is gone: {error.strerror or error}") from error
        if not packet:
            raise UnreachableError("the daemon closed the connection")
        try:
            return _replies.decode(packet)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise ControlError(f"the daemon speaks another version: {error}") from error

    def waiting(self) -> list[bytes]:
        """Packets that have come, in order, without waiting. Raises UnreachableError after the
        last one."""
        packets: list[bytes] = []
        while True:
            try:
                size = self._socket.recv_into(_buffer)
            except BlockingIOError:
                return packets
            except OSError as error:
                raise UnreachableError(f"the daemon is gone: {error.strerror}") from error
            if not size:
                raise UnreachableError("the daemon closed the connection")
            packets.append(bytes(memoryview(_buffer)[:size]))


async def _connect(connection: socket.socket, path: Path) -> None:
    """Connect, as soon as there is room: others may throng outside."""
    while True:
        try:
            return connection.connect(str(path))
        except BlockingIOError:
            await asyncio.sleep(_THRONG_S)


async def ask_once(path: Path, request: Request, timeout_s: float = _ANSWER_S) -> Reply:
    """Ask over a connection of its own: nothing that hangs elsewhere delays it."""
    async with await Link.open(path) as link:
        return await link.ask(request, timeout_s)
