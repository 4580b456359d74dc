"""Entrance of one door: listens, and lets in whom the socket file's group allows.

The file's mode says the same; the kernel is asked once more, for somebody may have opened the file
to all.
"""

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from daemon.protocol.doors import DOORS, Door
from daemon.protocol.messages import Reply
from daemon.protocol.socket_path import LISTEN_BACKLOG, Peer, groups_of, listen, peer_of
from daemon.service.connections import Connection

#: As many as the kernel keeps waiting outside.
MOST_OUTSIDE: Final = LISTEN_BACKLOG + 1


class Entrance:
    """Listens at `path` from construction to `close`; `numbers` counts connections, through all
    doors. Raises ControlError if another daemon serves `path`, or the file cannot be made."""

    def __init__(self, path: Path, door: Door, numbers: Iterator[int]) -> None:
        self.path, self.door = path, door
        self._listener = listen(path, DOORS[door].group)
        file = path.stat()
        self._inode, self._group = file.st_ino, file.st_gid
        self._numbers = numbers
        self.silent_at = self.looked = 0  # as of a connection: nobody was outside, somebody was

    def fileno(self) -> int:
        """Descriptor that is readable while somebody waits outside."""
        return self._listener.fileno()

    def close(self) -> None:
        """Remove the socket file, if it still is this one's."""
        self._listener.close()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._inode:
                self.path.unlink()

    def next(self) -> Connection | None:
        """The next who may come in; None if nobody is outside. Never waits."""
        for _ in range(MOST_OUTSIDE):
            try:
                accepted, _ = self._listener.accept()
            except OSError:  # gone again, or out of descriptors: looked at in the next tick
                return None
            accepted.setblocking(False)
            try:
                peer = peer_of(accepted, next(self._numbers))
            except OSError:
                accepted.close()
                continue
            if self._admits(accepted, peer):
                return Connection(accepted, accepted.fileno(), peer, self.door)
            reply = Reply(ok=False, message=f"you are not in the group of {self.path}: refused")
            with accepted, contextlib.suppress(OSError):
                accepted.send(msgspec.json.encode(reply))
        return None

    def _admits(self, accepted: socket.socket, peer: Peer) -> bool:
        """True if the socket file's group, owner or root is at the other end."""
        try:
            return peer.uid in (0, os.getuid()) or self._group in groups_of(accepted)
        except OSError:  # an old kernel, or too many groups to ask for: the file's mode has decided
            return True
