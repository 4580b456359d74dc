"""Connections of the control socket, and the lines in which they stand.

Each is either silent, and makes room for others the sooner the longer it has been so, or waits for
its turn with what it said. Readers stand beside them and make room for nobody.
"""

import socket
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from daemon.protocol.doors import DOORS, MAX_CONNECTIONS, Door
from daemon.protocol.socket_path import Peer

MOST_SAID: Final = 8  # packets of a connection that are kept for its turns
MAX_READERS: Final = 16
MAX_READERS_OF_ONE_USER: Final = 8


@dataclass(slots=True, eq=False)
class Connection:
    """One client."""

    socket: socket.socket
    file: int  # its descriptor
    peer: Peer
    door: Door = Door.CONTROL
    reads: bool = False
    gone: bool = False  # it says no more, and still is in the lines for what it said before
    # Packets that wait for their turns, None if too long, each with a moment after which it was
    # sent.
    said: deque[tuple[bytes | None, int]] = field(default_factory=deque)
    silent_at: int = 0  # the last moment at which it was known to have nothing more to say
    looked: int = 0  # the last poll in which it had something to say

    @property
    def full(self) -> bool:
        """True if the kernel keeps what else it says."""
        return len(self.said) >= MOST_SAID


@dataclass(slots=True)
class Connections:
    """All connections, by descriptor."""

    all: dict[int, Connection] = field(default_factory=dict)
    waiting: dict[int, Connection] = field(default_factory=dict)  # in the order of their turns
    readers: dict[int, Connection] = field(default_factory=dict)
    _silent: dict[int, Connection] = field(default_factory=dict)  # longest first

    def full(self, door: Door) -> bool:
        """True if a newcomer at `door` needs somebody else's place."""
        return len(self.all) >= MAX_CONNECTIONS or self._at(door) >= DOORS[door].connections

    def _at(self, door: Door) -> int:
        if DOORS[door].connections >= MAX_CONNECTIONS:
            return 0  # never more than all
        return sum(connection.door is door for connection in self.all.values())

    def add(self, connection: Connection) -> None:
        """Take in a newcomer, silent."""
        self.all[connection.file] = self._silent[connection.file] = connection

    def drop(self, connection: Connection) -> None:
        """Forget one that is closed."""
        for line in (self.all, self.waiting, self.readers, self._silent):
            line.pop(connection.file, None)

    def wait(self, connection: Connection) -> None:
        """Put one that has spoken at the end of those who wait, unless it waits already."""
        self._silent.pop(connection.file, None)
        self.waiting.setdefault(connection.file, connection)

    def next_turn(self) -> Connection:
        """Whose turn it is; from now on it is the last of those who wait, or silent."""
        connection = self.waiting.pop(next(iter(self.waiting)))
        if len(connection.said) > 1:
            self.wait(connection)
        else:
            self.served(connection)
        return connection

    def served(self, connection: Connection) -> None:
        """Count the silence of a connection from now on."""
        self._silent.pop(connection.file, None)
        if not connection.reads:
            self._silent[connection.file] = connection

    def set_reading(self, connection: Connection, reads: bool) -> None:
        """Make a connection a reader, or none any more."""
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

    def makes_room(self, spare: int) -> Connection:
        """The one that makes room: silent longest, or where none is silent, the one whose turn is
        farthest off; no reader, and not connection number `spare`. Those at the view door come
        first: nobody who commands the arm makes room for somebody who looks, while another does."""
        lines: tuple[Iterable[Connection], ...] = (
            self._silent.values(),
            reversed(self.waiting.values()),
        )
        others = [c for line in lines for c in line if c.peer.connection != spare and not c.reads]
        return next((c for c in others if c.door is Door.VIEW), others[0])
