"""Blocking client: one thread, one connection. `contactd_client.aio` is that for asyncio."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from contactd_client.connection import ANSWER_S, Connection, command_timeout_s
from contactd_client.errors import ContactdError
from contactd_client.messages import Reply, Request, Snapshot, State, Status
from contactd_client.packets import decode_reply, decode_state, encode, snapshot_of, status_of
from contactd_client.paths import usual_socket_path, view_socket_path
from contactd_client.stream import Stream

RETRY_S: Final = 0.25


@dataclass(frozen=True, slots=True)
class Joined:
    """Connection to a daemon established; its States follow."""

    snapshot: Snapshot


@dataclass(frozen=True, slots=True)
class Lost:
    """Connection lost or not established: the state of the arm is unknown."""

    why: str


class Client:
    """One connection to a daemon, from construction to `close`.

    `path` is one of its two sockets; by default the view socket, which permits no motion. Raises
    UnreachableError if there is no daemon, this user has no access, or it does not answer within
    `timeout_s` [s]; ControlError for an invalid answer.
    """

    def __init__(self, path: Path | None = None, timeout_s: float = ANSWER_S) -> None:
        self._timeout_s = timeout_s
        self._connection = Connection(path or view_socket_path(usual_socket_path()), timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; the arm is disarmed if this connection had armed it."""
        self._connection.close()

    def ask(self, request: Request) -> Reply:
        """Send a request and wait for the answer, which may be a refusal: check `ok`. Requests are
        never repeated."""
        timeout = command_timeout_s(request["command"], self._timeout_s)
        return decode_reply(self._connection.exchange(encode(request), timeout))

    def status(self) -> Status:
        """Status of the daemon. Raises ControlError if it is refused."""
        return status_of(self.ask({"command": "status"}))

    def follow(self) -> Stream:
        """Stream of targets for the arm to follow; needs the control socket."""
        return Stream(self._connection, self._timeout_s)

    def states(self) -> tuple[Snapshot, Iterator[State]]:
        """Snapshot, and an iterator over all subsequent States.

        The iterator never ends by itself: it raises UnreachableError if the daemon is gone or
        silent. A slow reader misses States: check their `tick`. Send no further requests on this
        connection.
        """
        return snapshot_of(self.ask({"command": "subscribe"})), self._iterate()

    def _iterate(self) -> Iterator[State]:
        while True:
            yield decode_state(self._connection.packet())


def watch(
    path: Path | None = None, *, timeout_s: float = ANSWER_S, retry_s: float = RETRY_S
) -> Iterator[Joined | Lost | State]:
    """Endless iterator over all States, which reconnects every `retry_s` [s] as needed.

    Each connection begins with `Joined`; `Lost` is yielded once whenever it is lost, and again if
    the reason changes. `path` and `timeout_s` are as for Client.
    """
    last = ""
    while True:
        try:
            with Client(path, timeout_s) as client:
                snapshot, states = client.states()
                last = ""
                yield Joined(snapshot)
                yield from states
        except ContactdError as error:
            if str(error) != last:
                last = str(error)
                yield Lost(last)
        time.sleep(retry_s)
