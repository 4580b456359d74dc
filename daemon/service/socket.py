"""Control socket, and the view socket beside it: polled by the tick and never waited for.

AF_UNIX with message boundaries (SOCK_SEQPACKET): one JSON message is one packet. Whoever may
connect is decided by the socket file's group; who did connect is known from the kernel, which is
asked once more. Which commands a door takes is said by `daemon/protocol/doors.py`; inside, all
connections stand in the same lines.

**`stop` and `disarm` come first.** Every `poll` takes what everybody has said and lets in everybody
who waits outside; a stop among these is served on the spot, whatever else is waiting. All other
requests are kept, eight a connection, and get their turn: at most four a poll, and none is begun
when the time is over, so that no client, however loud, takes more than a bounded share of a tick. A
connection's own requests stay in their order. Of who hangs up all is read at once.

What lets the arm move is refused unless it was sent after the last stop: the connection said
nothing more at some moment after that stop was served, or the stop was its own. Moments are counted
by what is looked at and read.

Where all places are taken, whoever has been silent longest makes room: those who only hold
connections lock nobody out. Nor can one user hold all the places of readers.
"""

import contextlib
import errno
import itertools
import math
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import MAX_CONNECTIONS, Door
from daemon.protocol.doors import refusal as refusal_at
from daemon.protocol.messages import (
    AWAITED,
    COMMANDS,
    MAX_REQUEST_BYTES,
    OUTDATED_BY,
    Command,
    Reply,
    Request,
    State,
)
from daemon.protocol.socket_path import Peer
from daemon.protocol.strict_json import StrictDecoder
from daemon.service.connections import Connection, Connections
from daemon.service.entrance import MOST_OUTSIDE, Entrance
from errors import ContactdError

TURNS_PER_POLL: Final = 4
LAST_WORDS: Final = 1024  # of all who have hung up, read in one poll; the kernel keeps 300 of each
SHORT_BYTES: Final = 128  # a stop is no longer; what is longer is looked at in its turn
_MADE_ROOM: Final = msgspec.json.encode(
    Reply(
        ok=False,
        message=f"closed to make room: more than {MAX_CONNECTIONS} connections, and this one idle",
    )
)
SEND_BUFFER_BYTES: Final = 1 << 20  # the kernel grants what net.core.wmem_max allows


Handler = Callable[[Request, Peer], Reply]
Listener = Callable[[Peer], None]


class ControlSocket:
    """Listens at `path`, and for those who only look at `view_socket_path(path)`, from construction
    to `close`; belongs to the one thread that polls it.

    Raises ControlError if another daemon serves `path`, or a file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with contextlib.ExitStack() as opened:
            numbers = itertools.count(1)
            self._entrances: dict[int, Entrance] = {}  # by descriptor, those who command first
            for door, place in ((Door.CONTROL, path), (Door.VIEW, view_socket_path(path))):
                entrance = Entrance(place, door, numbers)
                opened.callback(entrance.close)
                self._entrances[entrance.fileno()] = entrance
            opened.pop_all()
        self._epoll = select.epoll()
        for file in self._entrances:
            self._epoll.register(file, select.EPOLLIN)
        self._connections = Connections()
        self._poll = 0
        self._served_in: dict[Command, int] = dict.fromkeys(OUTDATED_BY, 0)
        self._moment = 0
        self._stopped_at: dict[Command, int] = dict.fromkeys(OUTDATED_BY, 0)  # each, by a moment
        self._began, self._began_before = 0, 0  # moments: this poll, and the one before
        self._last_words = LAST_WORDS
        self.spare = 0  # the number of a connection that never has to make room
        self.on_close: Listener = lambda _: None  # told of all that end, perhaps twice
        self._buffer = bytearray(MAX_REQUEST_BYTES)
        self._packet = bytearray()
        self._encoder = msgspec.json.Encoder()
        self._decoder = StrictDecoder(Request)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._connections.all)

    @property
    def readers(self) -> list[Connection]:
        """The connections that receive every State."""
        return list(self._connections.readers.values())

    def poll(
        self, handle: Handler, turns_s: float = math.inf, entrance_s: float = math.inf
    ) -> None:
        """Serve what is waiting, without blocking: one system call when nothing is.

        `handle` answers each well-formed request; a ContactdError that it raises becomes a refusal.
        After `entrance_s` nobody more is let in; after another `turns_s` no request's turn begins.
        One of each always does.
        """
        self._poll += 1
        self._began_before, self._began = self._began, self._next_moment()
        self._last_words = LAST_WORDS
        if events := self._epoll.poll(0, MAX_CONNECTIONS + 1):
            until_s = time.monotonic() + entrance_s  # with what those inside have said
            called = set()
            for file, what in events:
                if file in self._entrances:
                    called.add(file)
                else:
                    self._look_at(self._connections.all[file], handle, what)
            for file, entrance in self._entrances.items():
                if file in called:
                    self._let_in(entrance, handle, until_s)
        self._serve_in_turn(handle, turns_s)

    def _next_moment(self) -> int:
        self._moment += 1
        return self._moment

    def _look_at(self, connection: Connection, handle: Handler, events: int) -> None:
        if connection.gone:
            return
        if connection.looked < self._poll - 1:  # the poll before found nothing
            connection.silent_at = self._began_before
        connection.looked = self._poll
        if events & select.EPOLLHUP:
            self._hear_out(connection, handle)
            if connection.file in self._connections.waiting:
                # What it said before waits for its turn; what it owned must not.
                self.on_close(connection.peer)
        else:
            self._hear_all(connection, handle)

    def _serve_in_turn(self, handle: Handler, turns_s: float) -> None:
        waiting = self._connections.waiting
        if not waiting:
            return
        deadline = time.monotonic() + turns_s
        for _ in range(TURNS_PER_POLL):
            connection = self._connections.next_turn()
            packet, after = connection.said.popleft()
            reply = self._answer(connection, packet, after, handle)
            if not _has_hung_up(connection.socket):
                self._send(connection, reply)
            elif not connection.gone:
                self._hear_out(connection, handle)
            if connection.gone and not connection.said:
                self._drop(connection)
            if not waiting or time.monotonic() >= deadline:
                return

    def publish(self, state: State) -> None:
        """Send `state` to every reader that has room for it; encoded once, if there is a reader."""
        readers = self._connections.readers
        if not readers:
            return
        self._encoder.encode_into(state, self._packet)
        dead: list[Connection] | None = None
        for connection in readers.values():
            try:
                connection.socket.send(self._packet)
            except OSError as error:
                # Too slow, or with too little room: it misses this one, and sees so by its tick.
                if error.errno not in (errno.EAGAIN, errno.EMSGSIZE):
                    dead = [*(dead or []), connection]
        for connection in dead or ():
            self._drop(connection)

    def drop_all(self) -> None:
        """Close every connection: who comes meanwhile waits outside until the next `poll`."""
        for connection in list(self._connections.all.values()):
            self._drop(connection)
        self.spare, self.on_close = 0, lambda _: None

    def close(self) -> None:
        """Close every connection, and the entrance."""
        self.drop_all()
        self._epoll.close()
        for entrance in self._entrances.values():
            entrance.close()

    def _let_in(self, entrance: Entrance, handle: Handler, until_s: float) -> None:
        """Let in those who wait outside, and hear at once what each has to say."""
        if entrance.looked < self._poll - 1:
            entrance.silent_at = self._began_before
        entrance.looked = self._poll
        for _ in range(MOST_OUTSIDE):
            connection = entrance.next()
            if connection is None:
                entrance.silent_at = self._next_moment()
                return
            connection.silent_at, connection.looked = entrance.silent_at, self._poll
            if self._connections.full(entrance.door):
                self._make_room(handle, entrance.door)
            self._connections.add(connection)
            self._epoll.register(connection.file, select.EPOLLIN)
            self._hear_all(connection, handle)
            if time.monotonic() >= until_s:
                return

    def _make_room(self, handle: Handler, door: Door) -> None:
        while self._connections.full(door):
            connection = self._connections.makes_room(self.spare)
            if not connection.said and self._hear(connection, handle):
                continue
            self._hear_out(connection, handle)  # its last word may be a stop
            break
        else:
            return
        with contextlib.suppress(OSError):
            connection.socket.send(_MADE_ROOM)
        self._drop(connection)

    def _drop(self, connection: Connection) -> None:
        if connection.socket.fileno() < 0:
            return  # it is closed
        self._connections.drop(connection)
        # Closing would do, but not while a process that is being started holds a copy.
        self._epoll.unregister(connection.file)
        connection.socket.close()
        connection.gone = True
        self.on_close(connection.peer)

    def _hear_all(self, connection: Connection, handle: Handler) -> None:
        """Take what a connection has said, as far as it may be kept."""
        while not connection.full and self._hear(connection, handle):
            pass

    def _hear_out(self, connection: Connection, handle: Handler) -> None:
        """Take the last words of a connection, in several polls if there are many; a stop among
        them counts, however many there are."""
        while self._last_words:
            self._last_words -= 1
            if not self._hear(connection, handle):
                return

    def _hear(self, connection: Connection, handle: Handler) -> bool:
        """Take the next packet of a connection: serve a stop at once, keep anything else for its
        turn if there is room. A client that says no more is gone, and dropped if it waits for no
        turn. False if there was no packet."""
        try:
            size = self._receive(connection.socket)
        except BlockingIOError:
            connection.silent_at = self._next_moment()
            return False
        except OSError:
            size = 0
        if not size:  # an empty packet, which nobody sends, is an end, too
            connection.gone = True
            if not connection.said:
                self._drop(connection)
            return False
        self._next_moment()
        packet = bytes(self._buffer[:size]) if size <= MAX_REQUEST_BYTES else None
        if packet is not None and self._is_urgent(packet):
            if not connection.said:
                self._connections.served(connection)
            reply = self._answer(connection, packet, self._moment, handle)
            if not _has_hung_up(connection.socket):
                self._send(connection, reply)
            connection.silent_at = self._moment  # what it says now comes after its own stop
        elif not connection.full:
            connection.said.append((packet, connection.silent_at))
            self._connections.wait(connection)
        return not connection.gone

    def _receive(self, connected: socket.socket) -> int:
        """Size of the next packet, which may be more than there is room for; 0 at the end."""
        for _ in range(2):
            with contextlib.suppress(ConnectionResetError):
                return connected.recv_into(self._buffer, 0, socket.MSG_TRUNC)
            # Who hung up with answers unread is reported so once, ahead of its last words.
        return 0

    def _is_urgent(self, packet: bytes) -> bool:
        """True for a short, bare `stop` or `disarm`, the first of its kind in this poll: the arm
        stops by that one, and a flood of them must not keep others waiting."""
        if len(packet) > SHORT_BYTES:
            return False
        try:
            request = self._decoder.decode(packet)
        except msgspec.DecodeError:
            return False
        return (
            request.command in OUTDATED_BY
            and request == Request(request.command, on_behalf_of=request.on_behalf_of)
            and self._served_in[request.command] != self._poll
        )

    def _answer(
        self, connection: Connection, packet: bytes | None, after: int, handle: Handler
    ) -> Reply:
        """Carry out a packet that was sent after this moment."""
        if packet is None:
            return Reply(ok=False, message=f"a request has at most {MAX_REQUEST_BYTES} bytes")
        try:
            request = self._decoder.decode(packet)
        except msgspec.DecodeError as error:
            return Reply(
                ok=False,
                message=f'not a request: {error}; expected {{"command": ...}} with one of '
                + ", ".join(COMMANDS),
            )
        refusal = refusal_at(connection.door, request.command)
        refusal = refusal or self._outdated(request, after, connection)
        if request.command == "subscribe":
            refusal = refusal or self._connections.refuse_reader(connection)
        if refusal:
            return Reply(ok=False, message=f"{request.command}: {refusal}")
        try:
            reply = handle(request, connection.peer)
        except ContactdError as error:
            return Reply(ok=False, message=str(error))
        if request.command in OUTDATED_BY and reply.ok:
            self._served_in[request.command] = self._poll
            self._stopped_at[request.command] = self._next_moment()
        if request.command == "subscribe" and reply.ok:
            with contextlib.suppress(OSError):
                connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            self._connections.set_reading(connection, True)
        return reply

    def _outdated(self, request: Request, after: int, connection: Connection) -> str:
        """Reason why a request that lets the arm move is none any more; empty if it still is."""
        if request.command not in AWAITED:
            return ""
        for stop, outdated in OUTDATED_BY.items():
            if request.command in outdated and after < self._stopped_at[stop]:
                return f"a {stop} overtook it; ask again"
        if _has_hung_up(connection.socket):
            return "nobody waits for the answer"
        return ""

    def _send(self, connection: Connection, reply: Reply) -> None:
        packet = self._encoder.encode(reply)
        try:
            connection.socket.send(packet)
        except OSError as error:
            if error.errno != errno.EMSGSIZE or not reply.ok:
                self._drop(connection)
                return
            self._connections.set_reading(connection, False)
            text = f"an answer of {len(packet)} bytes does not fit: raise net.core.wmem_max"
            self._send(connection, Reply(ok=False, message=text))


def _has_hung_up(connected: socket.socket) -> bool:
    """True if nobody is at the other end any more."""
    looked = select.poll()
    looked.register(connected, 0)
    return bool(looked.poll(0))
