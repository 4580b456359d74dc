"""Client for asyncio. Apart from the rest, as importing asyncio takes longer than all of it."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Self

from contactd_client.aio_stream import AsyncStream
from contactd_client.client import RETRY_S, Joined, Lost
from contactd_client.connection import ANSWER_S, MAX_PACKET_BYTES, patience_s
from contactd_client.errors import ContactdError, HungUpError, UnreachableError
from contactd_client.messages import Reply, Request, Snapshot, State, Status
from contactd_client.packets import decode_reply, decode_state, encode, snapshot_of, status_of
from contactd_client.paths import usual_socket_path, view_socket_path, why_unreachable

_THRONG_S = 0.001  # the client that asks oftener gets in
_buffer = bytearray(MAX_PACKET_BYTES)  # nothing waits between a packet's arrival and its copy


class AsyncConnection:
    """One connection, from `open` to `close`. Every method raises UnreachableError where there is
    no daemon, and none that answers in time."""

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
        """Send a request and wait for its answer, for `timeout_s` [s] at most. The connection is
        closed where none comes: a late one would be taken for the answer to the next request."""
        if self._socket.fileno() < 0:
            raise UnreachableError("the daemon has ended or was silent: connect again")
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                # Where the daemon has closed, it may have sent the reason before: read on.
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
        """Next message, as it was sent, if it comes within `timeout_s` [s]."""
        try:
            async with asyncio.timeout(timeout_s):
                return await self._receive()
        except TimeoutError:
            raise UnreachableError("the daemon fell silent") from None

    def waiting(self) -> list[bytes]:
        """Packets that have come, in order, without waiting. Raises UnreachableError after the
        last one of a daemon that is gone."""
        packets: list[bytes] = []
        while True:
            try:
                size = self._socket.recv_into(_buffer)
            except BlockingIOError:
                return packets
            except OSError as error:
                raise _gone(error) from error
            if not size and packets:
                return packets  # the end is found by the next call
            if not size:
                raise HungUpError("the daemon closed the connection")
            packets.append(bytes(memoryview(_buffer)[:size]))

    async def _receive(self) -> bytes:
        loop = asyncio.get_running_loop()
        try:
            try:
                packet = await loop.sock_recv(self._socket, MAX_PACKET_BYTES)
            except ConnectionResetError:
                # Reported once, ahead of the messages that the daemon sent before it closed.
                packet = await loop.sock_recv(self._socket, MAX_PACKET_BYTES)
        except OSError as error:
            raise _gone(error) from error
        if not packet:
            raise HungUpError("the daemon closed the connection")
        return packet


class AsyncClient:
    """One connection to a daemon, from `open` to `close`; otherwise as `contactd_client.Client`."""

    def __init__(self, connection: AsyncConnection, timeout_s: float = ANSWER_S) -> None:
        self._connection, self._timeout_s = connection, timeout_s

    @classmethod
    async def open(cls, path: Path | None = None, timeout_s: float = ANSWER_S) -> Self:
        """Connect to the socket at `path`, by default the view socket."""
        path = path or view_socket_path(usual_socket_path())
        return cls(await AsyncConnection.open(path, timeout_s), timeout_s)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; the arm is disarmed if this connection had armed it."""
        self._connection.close()

    async def ask(self, request: Request) -> Reply:
        """Send a request and wait for the answer, which may be a refusal: look at `ok`. It is never
        sent twice. One at a time: no two tasks may ask on one connection."""
        patience = patience_s(request["command"], self._timeout_s)
        return decode_reply(await self._connection.exchange(encode(request), patience))

    async def status(self) -> Status:
        """The daemon's Status. Raises ControlError where it is refused."""
        return status_of(await self.ask({"command": "status"}))

    def follow(self) -> AsyncStream:
        """Stream of targets for the arm to follow; needs the control socket."""
        return AsyncStream(self._connection, self._timeout_s)

    async def states(self) -> tuple[Snapshot, AsyncIterator[State]]:
        """Snapshot, and an iterator over every State from then on, as of `Client.states`."""
        return snapshot_of(await self.ask({"command": "subscribe"})), self._iterate()

    async def _iterate(self) -> AsyncIterator[State]:
        while True:
            yield decode_state(await self._connection.packet(self._timeout_s))


async def watch(
    path: Path | None = None, *, timeout_s: float = ANSWER_S, retry_s: float = RETRY_S
) -> AsyncIterator[Joined | Lost | State]:
    """Every State for ever, as `contactd_client.watch`."""
    last = ""
    while True:
        try:
            async with await AsyncClient.open(path, timeout_s) as client:
                snapshot, states = await client.states()
                last = ""
                yield Joined(snapshot)
                async for state in states:
                    yield state
        except ContactdError as error:
            if str(error) != last:
                last = str(error)
                yield Lost(last)
        await asyncio.sleep(retry_s)


async def _connect(connection: socket.socket, path: Path) -> None:
    """Connect, as soon as there is room: others may throng outside."""
    while True:
        try:
            return connection.connect(str(path))
        except BlockingIOError:
            await asyncio.sleep(_THRONG_S)


def _gone(error: OSError) -> UnreachableError:
    return UnreachableError(f"the daemon is gone: {error.strerror or error}")
