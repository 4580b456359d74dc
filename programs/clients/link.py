"""Connection to one daemon for asyncio: requests that are answered, and States as they come.

`client.py` blocks; here one thread serves many daemons and browsers.
"""

from pathlib import Path
from typing import Self

import msgspec

from contactd_client.aio_connection import AsyncConnection
from contactd_client.connection import ANSWER_S
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Request
from programs.clients.client import decoded

_replies = msgspec.json.Decoder(Reply)


class Link:
    """One connection. Every method raises UnreachableError where there is no daemon, and none that
    answers in time."""

    def __init__(self, connection: AsyncConnection) -> None:
        self._connection = connection
        self.waiting = connection.waiting

    @classmethod
    async def open(cls, path: Path) -> Self:
        """Connect to the socket at `path`."""
        return cls(await AsyncConnection.open(path))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self._connection.close()

    async def ask(self, request: Request, timeout_s: float = ANSWER_S) -> Reply:
        """Send a request and wait for its answer, which may be a refusal. Raises ControlError for
        an answer that is not understood."""
        packet = await self._connection.exchange(msgspec.json.encode(request), timeout_s)
        return decoded(_replies, packet)


async def ask_once(path: Path, request: Request, timeout_s: float = ANSWER_S) -> Reply:
    """Ask over a connection of its own: nothing that hangs elsewhere delays it."""
    async with await Link.open(path) as link:
        return await link.ask(request, timeout_s)
