"""Reading of packets from connections: a stop is answered at once, all others wait their turn."""

import contextlib
import errno
import socket
from collections.abc import Callable
from typing import Final

import msgspec

from daemon.protocol.replies import Reply
from daemon.protocol.requests import MAX_REQUEST_BYTES
from daemon.service.answers import Answers, Handler, peer_closed
from daemon.service.connections import Connection, Connections

#: Packets of closed clients read in one poll; the kernel keeps 300 of each.
MOST_LAST_PACKETS: Final = 1024


class Receiver:
    """Reader of the packets of all connections of one daemon; `drop` closes a connection."""

    def __init__(
        self, connections: Connections, answers: Answers, drop: Callable[[Connection], None]
    ) -> None:
        self._connections, self._answers, self._drop = connections, answers, drop
        self._left = MOST_LAST_PACKETS
        self._buffer = bytearray(MAX_REQUEST_BYTES)
        self._encoder = msgspec.json.Encoder()

    def begin_poll(self, handle: Handler) -> int:
        """Begin a poll, in which `handle` answers requests; returns its first moment."""
        self._left = MOST_LAST_PACKETS
        return self._answers.begin_poll(handle)

    def receive_all(self, connection: Connection) -> None:
        """Read the packets of a connection, as long as there is room for them."""
        while not connection.full and self.receive(connection):
            pass

    def drain(self, connection: Connection) -> None:
        """Read the last packets of a connection, in several polls if there are many; a stop among
        them counts, however many there are."""
        while self._left:
            self._left -= 1
            if not self.receive(connection):
                return

    def receive(self, connection: Connection) -> bool:
        """Read the next packet of a connection: serve a stop at once, keep anything else for its
        turn if there is room. A client that has hung up is marked as gone, and dropped if it waits
        for no turn. False if there was no packet."""
        try:
            size = self._receive(connection.socket)
        except BlockingIOError:
            connection.silent_at = self._answers.next_moment()
            return False
        except OSError:
            size = 0
        if not size:  # the end, or an empty packet, which no client sends
            connection.gone = True
            if not connection.pending:
                self._drop(connection)
            return False
        self._answers.next_moment()
        packet = bytes(self._buffer[:size]) if size <= MAX_REQUEST_BYTES else None
        if packet is not None and self._answers.is_urgent(packet):
            if not connection.pending:
                self._connections.served(connection)
            self.answer(connection, packet, self._answers.moment)
            connection.silent_at = self._answers.moment  # its later packets follow its own stop
        elif not connection.full:
            connection.pending.append((packet, connection.silent_at))
            self._connections.wait(connection)
        return not connection.gone

    def _receive(self, connected: socket.socket) -> int:
        """Size of the next packet, which may exceed the buffer; 0 at the end."""
        try:
            return connected.recv_into(self._buffer, 0, socket.MSG_TRUNC)
        except ConnectionResetError:
            # A client that hung up with unread answers causes this once, before its last packets.
            with contextlib.suppress(ConnectionResetError):
                return connected.recv_into(self._buffer, 0, socket.MSG_TRUNC)
        return 0

    def answer(self, connection: Connection, packet: bytes | None, after: int) -> bool:
        """Answer a packet that was sent after this moment; False if the client has hung up."""
        reply = self._answers.answer(connection, packet, after)
        if peer_closed(connection.socket):
            return False
        self.send(connection, reply)
        return True

    def send(self, connection: Connection, reply: Reply) -> None:
        """Send an answer; a connection that does not take it is dropped."""
        try:
            packet = self._encoder.encode(reply)
        except Exception as error:
            packet = self._encoder.encode(self._answers.internal_error(connection, b"", error))
        try:
            connection.socket.send(packet)
        except OSError as error:
            if error.errno != errno.EMSGSIZE or not reply.ok:
                self._drop(connection)
                return
            self._connections.set_reading(connection, False)
            text = f"an answer of {len(packet)} bytes does not fit: raise net.core.wmem_max"
            self.send(connection, Reply(ok=False, message=text))
