"""Control socket: the daemon's only door, polled by the tick and never waited for.

AF_UNIX with message boundaries (SOCK_SEQPACKET): one JSON message is one packet. Whoever may
connect is decided by the socket file's group; who did connect is known from the kernel, which is
asked once more. One call of `poll` serves at most four requests and accepts at most four
connections, and begins none of this when its time is over, so that no client, however loud, takes
more than a bounded share of a tick. Where all places are taken, whoever has been silent longest
makes room: those who only hold connections lock nobody out.
"""

import contextlib
import errno
import math
import os
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from daemon.protocol.messages import AWAITED, COMMANDS, MAX_REQUEST_BYTES, Reply, Request, State
from daemon.protocol.socket_path import Peer, groups_of, listen, peer_of
from errors import ContactdError

MAX_CONNECTIONS = 32
MAX_READERS = 8
EVENTS_PER_POLL = 4
ACCEPTS_PER_EVENT = 4
SEND_BUFFER_BYTES = 1 << 20  # the kernel grants what net.core.wmem_max allows


@dataclass(slots=True)
class Connection:
    """One client."""

    socket: socket.socket
    peer: Peer
    reads: bool = False


Handler = Callable[[Request, Peer], Reply]
Listener = Callable[[Peer], None]


class ControlSocket:
    """Listens at `path` from construction to `close`; belongs to the one thread that polls it.

    Raises ControlError if another daemon serves `path`, or the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._listener = listen(path)
        file = path.stat()
        self._inode, self._group = file.st_ino, file.st_gid
        self._epoll = select.epoll()
        self._epoll.register(self._listener, select.EPOLLIN)
        self._connections: dict[int, Connection] = {}
        self._accepted = 0
        self.spare = 0  # the number of a connection that never has to make room
        self.on_close: Listener = lambda _: None  # told of every connection that ends
        self._buffer = bytearray(MAX_REQUEST_BYTES)
        self._packet = bytearray()
        self._encoder = msgspec.json.Encoder()
        self._decoder = msgspec.json.Decoder(Request)

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
        return len(self._connections)

    @property
    def readers(self) -> list[Connection]:
        """The connections that receive every State."""
        return [c for c in self._connections.values() if c.reads]

    def poll(self, handle: Handler, budget_s: float = math.inf) -> None:
        """Serve what is waiting, without blocking: one system call when nothing is.

        `handle` answers each well-formed request; a ContactdError that it raises becomes a refusal.
        Nothing more is begun when `budget_s` have passed.
        """
        deadline = time.monotonic() + budget_s
        for _ in range(EVENTS_PER_POLL):
            # The kernel moves what it reports to the end of its ready list, so every client gets
            # its turn; one at a time, or those that are not looked at would lose theirs.
            ready = self._epoll.poll(0, 1)
            if not ready:
                return
            ((file, events),) = ready
            if file == self._listener.fileno():
                for _ in range(ACCEPTS_PER_EVENT):
                    if not self._accept():
                        break
            else:
                self._serve(self._connections[file], handle, gone=bool(events & select.EPOLLHUP))
            if time.monotonic() >= deadline:
                return

    def publish(self, state: State) -> None:
        """Send `state` to every reader that has room for it; encoded once, if there is a reader."""
        encoded = False
        dead: list[Connection] | None = None
        for connection in self._connections.values():
            if not connection.reads:
                continue
            if not encoded:
                self._encoder.encode_into(state, self._packet)
                encoded = True
            try:
                connection.socket.send(self._packet)
            except OSError as error:
                # Too slow, or with too little room: it misses this one, and sees so by its tick.
                if error.errno not in (errno.EAGAIN, errno.EMSGSIZE):
                    dead = [*(dead or []), connection]
        for connection in dead or ():
            self._drop(connection)

    def close(self) -> None:
        """Close every connection and remove the socket file, if it still is this one's."""
        for connection in list(self._connections.values()):
            self._drop(connection)
        self._epoll.close()
        self._listener.close()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._inode:
                self.path.unlink()

    def _accept(self) -> bool:
        """Take in the client that waits next; False if none does."""
        try:
            accepted, _ = self._listener.accept()
        except OSError:  # gone again, or out of descriptors: it will be looked at in the next tick
            return False
        accepted.setblocking(False)
        if not self._admitted(accepted):
            reply = Reply(ok=False, message=f"you are not in the group of {self.path}: refused")
            with accepted, contextlib.suppress(OSError):
                accepted.send(self._encoder.encode(reply))
            return True
        if len(self._connections) >= MAX_CONNECTIONS:
            self._make_room()
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._accepted += 1
        peer = peer_of(accepted, self._accepted)
        self._connections[accepted.fileno()] = Connection(accepted, peer)
        self._epoll.register(accepted, select.EPOLLIN)
        return True

    def _admitted(self, accepted: socket.socket) -> bool:
        """True if the socket file's group, owner or root is at the other end: what the file's mode
        says, even where somebody has opened it to all."""
        try:
            return peer_of(accepted).uid in (0, os.getuid()) or self._group in groups_of(accepted)
        except OSError:  # an old kernel, or too many groups to ask for: the file's mode has decided
            return True

    def _make_room(self) -> None:
        """Close the connection that has been silent longest, but no reader and not the spared."""
        idle = (c for c in self._connections.values() if not c.reads)
        connection = next(c for c in idle if c.peer.connection != self.spare)
        text = f"closed to make room: more than {MAX_CONNECTIONS} connections, and this one idle"
        with contextlib.suppress(OSError):
            connection.socket.send(self._encoder.encode(Reply(ok=False, message=text)))
        self._drop(connection)

    def _drop(self, connection: Connection) -> None:
        del self._connections[connection.socket.fileno()]
        connection.socket.close()  # which also takes it out of the epoll set
        self.on_close(connection.peer)

    def _serve(self, connection: Connection, handle: Handler, *, gone: bool) -> None:
        """Read one packet and answer it; a client that is gone or takes no answer is dropped."""
        try:
            size, _, flags, _ = connection.socket.recvmsg_into([self._buffer])
        except BlockingIOError:
            return
        except OSError:
            size = 0
            flags = 0
        if size == 0:
            self._drop(connection)
            return
        # Whoever speaks goes to the end of the line of those who make room.
        self._connections[connection.socket.fileno()] = self._connections.pop(
            connection.socket.fileno()
        )
        if flags & socket.MSG_TRUNC:
            reply = Reply(ok=False, message=f"a request has at most {MAX_REQUEST_BYTES} bytes")
        else:
            reply = self._answer(bytes(self._buffer[:size]), connection, handle, gone=gone)
        self._send(connection, reply)

    def _answer(
        self, packet: bytes, connection: Connection, handle: Handler, *, gone: bool
    ) -> Reply:
        try:
            request = self._decoder.decode(packet)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            return Reply(
                ok=False,
                message=f'not a request: {error}; expected {{"command": ...}} with one of '
                + ", ".join(COMMANDS),
            )
        if gone and request.command in AWAITED:
            return Reply(ok=False, message=f"{request.command}: nobody waits for the answer")
        subscribes = request.command == "subscribe"
        if subscribes and not connection.reads and len(self.readers) >= MAX_READERS:
            return Reply(ok=False, message=f"too many readers, at most {MAX_READERS}")
        try:
            reply = handle(request, connection.peer)
        except ContactdError as error:
            return Reply(ok=False, message=str(error))
        connection.reads = connection.reads or (subscribes and reply.ok)
        return reply

    def _send(self, connection: Connection, reply: Reply) -> None:
        packet = self._encoder.encode(reply)
        try:
            connection.socket.send(packet)
        except OSError as error:
            if error.errno != errno.EMSGSIZE or not reply.ok:
                self._drop(connection)
                return
            connection.reads = False
            text = f"an answer of {len(packet)} bytes does not fit: raise net.core.wmem_max"
            self._send(connection, Reply(ok=False, message=text))
