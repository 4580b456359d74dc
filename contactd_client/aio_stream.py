"""Stream of targets for asyncio: as `contactd_client.stream`, with `await`."""

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Self

from contactd_client.errors import ControlError, UnreachableError
from contactd_client.messages import Reply, StreamState
from contactd_client.targets import MOST_MISSING, PAUSE, Targets

if TYPE_CHECKING:
    from contactd_client.aio import AsyncConnection


class AsyncStream:
    """Stream of one AsyncClient, from its first target to the end of the `async with` block."""

    def __init__(
        self,
        connection: "AsyncConnection",
        timeout_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._connection, self._timeout_s = connection, timeout_s
        self._targets = Targets(clock)
        self._missing = 0

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None or not issubclass(error, ControlError):
            with contextlib.suppress(UnreachableError):  # its connection was closed meanwhile
                await self.end()

    @property
    def reply(self) -> Reply | None:
        """Latest answer; None before the first."""
        return self._targets.reply

    @property
    def state(self) -> StreamState | None:
        """Latest report of the daemon, as of `Stream`."""
        return self._targets.state

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
        """Halt the arm, if it follows."""
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
