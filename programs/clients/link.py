"""Asyncio connection to one daemon.

Unlike the blocking `client.py`, it lets one thread serve many daemons and browsers.
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
    """One connection. All methods raise UnreachableError if there is no daemon, or on timeout."""

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
        """Send a request and wait for its reply, which may be a refusal. Raises ControlError for a
        reply that cannot be decoded."""
        packet = await self._connection.exchange(msgspec.json.encode(request), timeout_s)
        return decoded(_replies, packet)


async def ask_once(path: Path, request: Request, timeout_s: float = ANSWER_S) -> Reply:
    """Reply to a request over a separate connection, which no hanging request delays."""
    async with await Link.open(path) as link:
        return await link.ask(request, timeout_s)
