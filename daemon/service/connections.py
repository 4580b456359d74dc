"""Connections of the control socket, and the queues in which they wait.

Each is either silent (those silent longest are closed first for newcomers), or waits for its turn
with its pending packets. Readers are separate and are never closed for newcomers.
"""

import socket
import sys
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Final

from daemon.protocol.doors import DOORS, MAX_CONNECTIONS, Door
from daemon.protocol.socket_path import Peer

MOST_PENDING: Final = 8  # packets of a connection that are queued for its turns
GRACE: Final = 10  # polls in which a newcomer has time for its first packet
MAX_READERS: Final = 16
MAX_READERS_OF_ONE_USER: Final = 8


@dataclass(slots=True, eq=False)
class Connection:
    """Connection of one client."""

    socket: socket.socket
    file: int  # its descriptor
    peer: Peer
    door: Door = Door.CONTROL
    reads: bool = False
    gone: bool = False  # closed by the client, and still queued for its pending packets
    # Packets that wait for their turns, None if too long, each with a moment after which it was
    # sent.
    pending: deque[tuple[bytes | None, int]] = field(default_factory=deque)
    silent_at: int = 0  # last moment at which it was known to have no packet to read
    entered: int = 0  # poll in which it was admitted
    looked: int = 0  # last poll in which it had a packet to read

    @property
    def full(self) -> bool:
        """True if further packets must stay in the kernel."""
        return len(self.pending) >= MOST_PENDING


@dataclass(slots=True)
class Connections:
    """All connections, by descriptor; `places` for all together."""

    places: int = MAX_CONNECTIONS
    all: dict[int, Connection] = field(default_factory=dict)
    waiting: dict[int, Connection] = field(default_factory=dict)  # in the order of their turns
    readers: dict[int, Connection] = field(default_factory=dict)
    # By door and user, those silent longest first.
    _silent: dict[tuple[Door, int], dict[int, Connection]] = field(default_factory=dict)
    _at: Counter[Door] = field(default_factory=Counter)
    _of: Counter[int] = field(default_factory=Counter)  # by user

    def full(self, door: Door) -> bool:
        """True if a newcomer at `door` needs the place of another connection."""
        return len(self.all) >= self.places or self._at[door] >= DOORS[door].connections

    def add(self, connection: Connection) -> None:
        """Add a newcomer, as silent."""
        self.all[connection.file] = connection
        self._at[connection.door] += 1
        self._of[connection.peer.uid] += 1
        self._silent_like(connection)[connection.file] = connection

    def drop(self, connection: Connection) -> None:
        """Remove a closed connection."""
        if self.all.pop(connection.file, None) is None:
            return
        for line in (self.waiting, self.readers, self._silent_like(connection)):
            line.pop(connection.file, None)
        self._at[connection.door] -= 1
        uid = connection.peer.uid
        self._of[uid] -= 1
        if not self._of[uid]:
            del self._of[uid]
            for door in Door:
                self._silent.pop((door, uid), None)

    def _silent_like(self, connection: Connection) -> dict[int, Connection]:
        return self._silent.setdefault((connection.door, connection.peer.uid), {})

    def wait(self, connection: Connection) -> None:
        """Put a connection with a packet at the end of the queue, unless it waits already."""
        self._silent_like(connection).pop(connection.file, None)
        self.waiting.setdefault(connection.file, connection)

    def next_turn(self) -> Connection:
        """Connection whose turn it is; it is then the last in the queue, or silent."""
        connection = self.waiting.pop(next(iter(self.waiting)))
        if len(connection.pending) > 1:
            self.wait(connection)
        else:
            self.served(connection)
        return connection

    def served(self, connection: Connection) -> None:
        """Mark a connection as silent from now on."""
        line = self._silent_like(connection)
        line.pop(connection.file, None)
        if not connection.reads:
            line[connection.file] = connection

    def set_reading(self, connection: Connection, reads: bool) -> None:
        """Make a connection a reader, or end its reading."""
        connection.reads = reads
        if reads:
            self.readers[connection.file] = connection
        else:
            self.readers.pop(connection.file, None)
        self.served(connection)

    def refuse_reader(self, connection: Connection) -> str:
        """Reason why a connection may not become a reader; empty if it may, or is one."""
        if connection.reads:
            return ""
        own = [c.peer.pid for c in self.readers.values() if c.peer.uid == connection.peer.uid]
        if len(own) >= MAX_READERS_OF_ONE_USER:
            pids = ", ".join(str(pid) for pid in sorted(set(own)))
            return f"too many readers of one user, at most {MAX_READERS_OF_ONE_USER} (pid {pids})"
        if len(self.readers) >= MAX_READERS:
            return f"too many readers, at most {MAX_READERS}"
        return ""

    def makes_room(self, spare: int, uid: int, poll: int = sys.maxsize) -> Connection | None:
        """Connection to close for a newcomer of user `uid` in a poll; not a reader, and not
        connection number `spare`. None if there is no such connection.

        Those at the view door come first: a client that commands the arm is not closed for an
        observer while another can be. Of those at a door it is one of the user with most
        connections, so that no user takes the places of another: the one silent longest; or, if
        none has been silent for GRACE polls, the one whose turn is farthest off; then the newcomer
        who came first.
        """
        users = sorted(self._of, key=lambda one: self._of[one] + (one == uid), reverse=True)
        for door in (Door.VIEW, Door.CONTROL):
            for user in users if self._at[door] else ():
                silent = self._longest_silent(door, user, spare)
                if silent is not None and silent.entered + GRACE <= poll:
                    return silent
                if found := self._farthest_off(door, user, spare) or silent:
                    return found
        return None

    def _longest_silent(self, door: Door, uid: int, spare: int) -> Connection | None:
        line = self._silent.get((door, uid), {}).values()
        return next((c for c in line if c.peer.connection != spare), None)

    def _farthest_off(self, door: Door, uid: int, spare: int) -> Connection | None:
        """Connection of user `uid` at `door` whose turn is farthest off, if it may be closed."""
        for connection in reversed(self.waiting.values()):
            peer = connection.peer
            movable = not connection.reads and peer.connection != spare
            if movable and peer.uid == uid and connection.door is door:
                return connection
        return None
