"""Client for asyncio, in a separate module as importing asyncio is slow."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Self

from contactd_client.aio_connection import AsyncConnection
from contactd_client.aio_stream import AsyncStream
from contactd_client.client import RETRY_S, Joined, Lost
from contactd_client.connection import ANSWER_S, command_timeout_s
from contactd_client.errors import ContactdError
from contactd_client.messages import Reply, Request, Snapshot, State, Status
from contactd_client.packets import decode_reply, decode_state, encode, snapshot_of, status_of
from contactd_client.paths import usual_socket_path, view_socket_path


class AsyncClient:
    """One connection to a daemon, from `open` to `close`; otherwise like `Client`."""

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
        """Send a request and wait for the answer, which may be a refusal: check `ok`. Requests are
        never repeated. At most one task at a time may use a connection."""
        timeout = command_timeout_s(request["command"], self._timeout_s)
        return decode_reply(await self._connection.exchange(encode(request), timeout))

    async def status(self) -> Status:
        """Status of the daemon. Raises ControlError if it is refused."""
        return status_of(await self.ask({"command": "status"}))

    def follow(self) -> AsyncStream:
        """Stream of targets for the arm to follow; needs the control socket."""
        return AsyncStream(self._connection, self._timeout_s)

    async def states(self) -> tuple[Snapshot, AsyncIterator[State]]:
        """Snapshot, and an iterator over all subsequent States, as `Client.states`."""
        return snapshot_of(await self.ask({"command": "subscribe"})), self._iterate()

    async def _iterate(self) -> AsyncIterator[State]:
        while True:
            yield decode_state(await self._connection.packet(self._timeout_s))


async def watch(
    path: Path | None = None, *, timeout_s: float = ANSWER_S, retry_s: float = RETRY_S
) -> AsyncIterator[Joined | Lost | State]:
    """Endless iterator over all States, as `contactd_client.watch`."""
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
