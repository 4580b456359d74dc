"""Control socket, and the view socket beside it: polled after each tick, without blocking.

AF_UNIX with message boundaries (SOCK_SEQPACKET): one JSON message is one packet. The socket file's
group decides who may connect; the kernel, which is asked once more, identifies the process that did
connect. `daemon/protocol/doors.py` defines the commands of each door; inside, all connections share
the same queues.

**`stop` and `disarm` come first.** Every `poll` reads the packets of all connections and admits all
clients that wait outside; a stop among these is served at once, whatever else is waiting. All other
requests are kept, eight a connection, and get their turn: at most four a poll, and none is begun
when the time is over, so that no client takes more than a bounded share of a tick. A connection's
own requests stay in their order. All packets of a client that hangs up are read at once.

A request that lets the arm move is refused unless it was sent after the last stop: the connection
had no packet to read at some moment after that stop was served, or the stop was its own. Moments
are values of a counter that polls and reads advance.

When all places are taken, the connection that has been silent longest is closed: clients that only
hold connections cannot lock others out. Nor can one user hold all the places of readers.
"""

import contextlib
import errno
import itertools
import math
import select
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

import msgspec

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import MAX_CONNECTIONS, Door
from daemon.protocol.replies import Reply
from daemon.protocol.socket_path import Peer
from daemon.protocol.state import State
from daemon.service.answers import Answers, Handler
from daemon.service.connections import Connection, Connections
from daemon.service.listener import MOST_OUTSIDE, Listener, NoDescriptorError, places
from daemon.service.receiver import Receiver

TURNS_PER_POLL: Final = 4
_MADE_ROOM: Final = Reply(
    ok=False,
    message=f"closed to make room: more than {MAX_CONNECTIONS} connections, and this one idle",
)
LEAST_SHARE: Final = 0.5  # of the time for the listener, left after reading all connections


class ControlSocket:
    """Control socket at `path`, and for observers at `view_socket_path(path)`, open from
    construction to `close`; for use by the one thread that polls it.

    Raises ControlError if another daemon serves `path`, or a file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with contextlib.ExitStack() as opened:
            numbers = itertools.count(1)
            self._listeners: dict[int, Listener] = {}  # by descriptor, that for commands first
            for door, place in ((Door.CONTROL, path), (Door.VIEW, view_socket_path(path))):
                listener = Listener(place, door, numbers)
                opened.callback(listener.close)
                self._listeners[listener.fileno()] = listener
            opened.pop_all()
        self._epoll = select.epoll()
        for file in self._listeners:
            self._epoll.register(file, select.EPOLLIN)
        self._connections = Connections(places())
        self.answers = Answers(self._connections)
        self._receiver = Receiver(self._connections, self.answers, self._drop)
        self._poll = 0
        self._began, self._began_before = 0, 0  # moments of this poll, and of the previous one
        self.clock: Callable[[], float] = time.monotonic
        self.spare = 0  # the number of a connection that is never closed for a newcomer
        self.on_close: Callable[[Peer], None] = lambda _: (
            None
        )  # called for all that end, perhaps twice
        self._packet = bytearray()
        self._encoder = msgspec.json.Encoder()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._connections.all)

    @property
    def readers(self) -> list[Connection]:
        """Connections that receive every State."""
        return list(self._connections.readers.values())

    def poll(
        self, handle: Handler, turns_s: float = math.inf, entrance_s: float = math.inf
    ) -> None:
        """Serve waiting clients and requests, without blocking: one system call if there are none.

        `handle` answers each well-formed request; a ContactdError that it raises becomes a refusal.
        After `entrance_s` no more clients are admitted; after another `turns_s` no request is
        begun. At least one of each is served.
        """
        self._poll += 1
        self._began_before, self._began = self._began, self._receiver.begin_poll(handle)
        if events := self._epoll.poll(0, MAX_CONNECTIONS + 1):
            until_s = self.clock() + entrance_s  # including the packets of connections
            called = set()
            for file, what in events:
                if file in self._listeners:
                    called.add(file)
                elif connection := self._connections.all.get(file):
                    self._read_connection(connection, what)
            # Even after reading many packets: a client with a stop may be outside.
            until_s = max(until_s, self.clock() + LEAST_SHARE * entrance_s)
            doors = [file for file in self._listeners if file in called]
            for file in doors if self._poll % 2 else doors[::-1]:  # in alternating order
                # A crowd at one door does not keep clients at the other from entering.
                share_s = max(until_s - self.clock(), 0.0) / len(called)
                called.discard(file)
                self._admit(self._listeners[file], self.clock() + share_s)
        self._serve_in_turn(turns_s)

    def _read_connection(self, connection: Connection, events: int) -> None:
        if connection.gone:
            return
        if connection.looked < self._poll - 1:  # the previous poll found nothing
            connection.silent_at = self._began_before
        connection.looked = self._poll
        if events & select.EPOLLHUP:
            self._receiver.drain(connection)
            if connection.file in self._connections.waiting:
                # Its pending packets wait for their turn; its lease and motion end now.
                self.on_close(connection.peer)
        else:
            self._receiver.receive_all(connection)

    def _serve_in_turn(self, turns_s: float) -> None:
        waiting = self._connections.waiting
        if not waiting:
            return
        deadline = self.clock() + turns_s
        for _ in range(TURNS_PER_POLL):
            connection = self._connections.next_turn()
            packet, after = connection.pending.popleft()
            heard = self._receiver.answer(connection, packet, after)
            if not heard and not connection.gone:
                self._receiver.drain(connection)
            if connection.gone and not connection.pending:
                self._drop(connection)
            if not waiting or self.clock() >= deadline:
                return

    def publish(self, state: State) -> None:
        """Send `state`, encoded once, to every reader that has room for it."""
        readers = self._connections.readers
        if not readers:
            return
        self._encoder.encode_into(state, self._packet)
        dead: list[Connection] | None = None
        for connection in readers.values():
            try:
                connection.socket.send(self._packet)
            except OSError as error:
                # Too slow, or with too little room: it misses this State, as `tick` shows.
                if error.errno not in (errno.EAGAIN, errno.EMSGSIZE):
                    dead = [*(dead or []), connection]
        for connection in dead or ():
            self._drop(connection)

    def drop_all(self) -> None:
        """Close every connection: new clients wait outside until the next `poll`."""
        for connection in list(self._connections.all.values()):
            self._drop(connection)
        self.spare, self.on_close = 0, lambda _: None
        self.answers.on_internal_error = lambda *_: None

    def close(self) -> None:
        """Close every connection and listener."""
        self.drop_all()
        self._epoll.close()
        for listener in self._listeners.values():
            listener.close()

    def _admit(self, listener: Listener, until_s: float) -> None:
        """Admit the clients that wait outside, and read the packets of each at once."""
        if listener.looked < self._poll - 1:
            listener.silent_at = self._began_before
        listener.looked = self._poll
        for _ in range(MOST_OUTSIDE):
            try:
                connection = listener.next()
            except NoDescriptorError:
                # The next client gets the descriptor of a connection that is closed for it.
                if self._free_one(uid=-1):
                    continue
                return
            if connection is None:
                listener.silent_at = self.answers.next_moment()
                return
            connection.silent_at = listener.silent_at
            connection.entered = connection.looked = self._poll
            while self._connections.full(listener.door) and self._free_one(connection.peer.uid):
                pass
            try:
                self._epoll.register(connection.file, select.EPOLLIN)
            except OSError:  # the machine lacks resources for it
                connection.socket.close()
                continue
            self._connections.add(connection)
            self._receiver.receive_all(connection)
            if self.clock() >= until_s:
                return

    def _free_one(self, uid: int) -> bool:
        """Close one connection, for a newcomer of user `uid`, once all its packets are read; False
        if none can be closed."""
        while connection := self._connections.makes_room(self.spare, uid, self._poll):
            if connection.pending:
                self._receiver.drain(connection)  # its last packet may be a stop
            elif self._receiver.receive(connection):
                continue
            if not connection.gone:
                self._receiver.send(connection, _MADE_ROOM)
            self._drop(connection)
            return True
        return False

    def _drop(self, connection: Connection) -> None:
        if connection.socket.fileno() < 0:
            return  # closed already
        self._connections.drop(connection)
        # Closing is not enough while a process that is being started holds a copy.
        self._epoll.unregister(connection.file)
        connection.socket.close()
        connection.gone = True
        self.on_close(connection.peer)
