"""Stream of targets for asyncio: like `contactd_client.stream`, with `await`."""

import contextlib
from collections.abc import Sequence
from typing import Self

from contactd_client.aio_connection import AsyncConnection
from contactd_client.errors import ControlError, UnreachableError
from contactd_client.targets import MOST_MISSING, PAUSE, TargetStream


class AsyncStream(TargetStream[AsyncConnection]):
    """Stream of one AsyncClient, from its first target to the end of the `async with` block."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None or not issubclass(error, ControlError):
            with contextlib.suppress(UnreachableError):  # the connection may be closed by now
                await self.end()

    async def to(
        self,
        q: Sequence[float],
        velocity: Sequence[float] | None = None,
        sent_s: float | None = None,
    ) -> None:
        """Send the next target, as `Stream.to`."""
        if self.reply is None:
            await self._exchange(self._targets.follow(q, sent_s))
            return
        await self._connection.send(self._targets.target(q, velocity, sent_s), self._timeout_s)
        self._missing += 1
        for packet in self._connection.waiting():
            self._missing -= 1
            self._targets.accept(packet)
        if self._missing > MOST_MISSING:
            raise UnreachableError("the daemon does not answer the stream")

    async def rejoin(self, q: Sequence[float], sent_s: float | None = None) -> None:
        """Let the arm rejoin the stream at q, as `Stream.rejoin`."""
        await self._await_answers()
        await self._exchange(self._targets.follow(q, sent_s))

    async def end(self) -> None:
        """Halt the arm if it follows."""
        if self._targets.follows:
            await self._await_answers()
            await self._exchange(PAUSE)

    async def _await_answers(self) -> None:
        while self._missing:
            packet = await self._connection.packet(self._timeout_s)
            self._missing -= 1
            self._targets.accept(packet)

    async def _exchange(self, request: bytes) -> None:
        self._targets.accept(await self._connection.exchange(request, self._timeout_s))
