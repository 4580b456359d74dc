"""Answers to the packets of the sockets' clients, and refusal of requests overtaken by a stop.

Every packet is answered: one that is not a request, that a door does not take, that came before a
stop, or that causes an error inside the daemon is refused with the reason. Moments are values of a
counter that polls and reads advance: a request that lets the arm move must have been sent after the
last stop.
"""

import contextlib
import select
import socket
from collections.abc import Callable
from typing import Final

import msgspec

from common.errors import ContactdError
from daemon.protocol.doors import refusal as refusal_at
from daemon.protocol.replies import Reply
from daemon.protocol.requests import (
    AWAITED,
    COMMANDS,
    MAX_REQUEST_BYTES,
    OUTDATED_BY,
    Command,
    Request,
    bare,
    fields_of,
)
from daemon.protocol.socket_path import Peer
from daemon.protocol.strict_json import StrictDecoder
from daemon.service.connections import Connection, Connections
from daemon.service.internal_errors import error_in_words

SHORT_BYTES: Final = 128  # longest stop; longer packets are decoded in their turn
SEND_BUFFER_BYTES: Final = 1 << 20  # the kernel grants what net.core.wmem_max allows

Handler = Callable[[Request, Peer], Reply]
InternalErrorListener = Callable[[bytes, Peer, Exception], None]


class Answers:
    """Answers to all connections of one daemon."""

    def __init__(self, connections: Connections) -> None:
        self.moment = 0
        # called with the packet, its sender, and the unexpected error
        self.on_internal_error: InternalErrorListener = lambda *_: None
        self._connections = connections
        self._served: set[Command] = set()  # stops that were served in this poll
        self._stopped_at: dict[Command, int] = dict.fromkeys(OUTDATED_BY, 0)  # latest moment
        self._decoder: StrictDecoder[Request] = StrictDecoder(Request)

    def begin_poll(self, handle: Handler) -> int:
        """Begin a poll, in which `handle` answers requests; returns its first moment."""
        self._handle = handle
        self._served.clear()
        return self.next_moment()

    def next_moment(self) -> int:
        """Advance the counter by one; returns the new moment."""
        self.moment += 1
        return self.moment

    def is_urgent(self, packet: bytes) -> bool:
        """True for a short, bare `stop` or `disarm`, the first of its kind in this poll: the arm
        stops by that one, and a flood of them must not keep others waiting."""
        if len(packet) > SHORT_BYTES:
            return False
        try:
            request = self._decoder.decode(packet)
        except Exception:  # answered in its turn
            return False
        return (
            request.command in OUTDATED_BY
            and request == bare(request.command, request.on_behalf_of)
            and request.command not in self._served
        )

    def answer(self, connection: Connection, packet: bytes | None, after: int) -> Reply:
        """Answer to a packet that was sent after this moment; None: the packet was too long."""
        try:
            return self._answered(connection, packet, after)
        except ContactdError as error:
            return Reply(ok=False, message=str(error))
        except Exception as error:
            return self.internal_error(connection, packet or b"", error)

    def internal_error(self, connection: Connection, packet: bytes, error: Exception) -> Reply:
        """Answer to a packet at which the program raised an error."""
        self.on_internal_error(packet, connection.peer, error)
        return Reply(ok=False, message=f"{error_in_words(error)}; see the daemon's log")

    def _answered(self, connection: Connection, packet: bytes | None, after: int) -> Reply:
        """Reply to a packet, after carrying it out. Raises any error in doing so."""
        if packet is None:
            return Reply(ok=False, message=f"a request has at most {MAX_REQUEST_BYTES} bytes")
        try:
            request = self._decoder.decode(packet)
        except msgspec.DecodeError as error:
            return Reply(ok=False, message=_no_request(packet, str(error)))
        refusal = refusal_at(connection.door, request.command)
        refusal = refusal or self._outdated(request, after, connection)
        if request.command == "subscribe":
            refusal = refusal or self._connections.refuse_reader(connection)
        if refusal:
            return Reply(ok=False, message=f"{request.command}: {refusal}")
        reply = self._handle(request, connection.peer)
        if request.command in OUTDATED_BY and reply.ok:
            self._served.add(request.command)
            self._stopped_at[request.command] = self.next_moment()
        if request.command == "subscribe" and reply.ok:
            with contextlib.suppress(OSError):
                connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            self._connections.set_reading(connection, True)
        return reply

    def _outdated(self, request: Request, after: int, connection: Connection) -> str:
        """Reason why a request that lets the arm move is outdated; empty if it is not."""
        if request.command not in AWAITED:
            return ""
        for stop, outdated in OUTDATED_BY.items():
            if request.command in outdated and after < self._stopped_at[stop]:
                return f"a {stop} overtook it"
        if peer_closed(connection.socket):
            return "the client has hung up"
        return ""


def _no_request(packet: bytes, problem: str) -> str:
    """Refusal of a packet that is not a request; with the fields of its command, or all commands,
    unless the problem is about one field."""
    text = f"not a request: {problem}"
    if "`$." in problem and "`$.command" not in problem:
        return text
    command = _command_in(packet)
    if command is not None:
        fields = ", ".join(f"`{name}`" for name in fields_of(command))
        return f"{text}; {command} takes {fields}"
    return f'{text}; expected {{"command": ...}} with one of {", ".join(COMMANDS)}'


def _command_in(packet: bytes) -> Command | None:
    """Command of a packet that is otherwise not a request; None without one."""
    try:
        return msgspec.json.decode(packet, type=_Named).command
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


class _Named(msgspec.Struct):
    command: Command


def peer_closed(connected: socket.socket) -> bool:
    """True if the other end has closed the connection."""
    looked = select.poll()
    looked.register(connected, 0)
    return bool(looked.poll(0))
