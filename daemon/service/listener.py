"""Listener of one door: listens, and admits the clients that the socket file's group allows.

The file's mode already ensures this; credentials are checked once more, as the file may have been
opened to all.
"""

import contextlib
import errno
import os
import resource
import select
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from daemon.protocol.doors import DOORS, MAX_CONNECTIONS, Door
from daemon.protocol.replies import Reply
from daemon.protocol.socket_path import LISTEN_BACKLOG, Peer, groups_of, listen, peer_of
from daemon.service.connections import Connection

#: Clients that the kernel keeps waiting outside, at most.
MOST_OUTSIDE: Final = LISTEN_BACKLOG + 1
SPARED_FILES: Final = 64  # descriptors for the daemon's own files
FEWEST_PLACES: Final = 8


def places() -> int:
    """Places for connections: MAX_CONNECTIONS, or fewer if this process may open too few files. The
    limit is raised as far as allowed; descriptors for the daemon's own files are reserved."""
    wanted = MAX_CONNECTIONS + SPARED_FILES
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return MAX_CONNECTIONS
    soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return max(soft - SPARED_FILES, FEWEST_PLACES)


class NoDescriptorError(Exception):
    """A client waits outside, and the process or the machine has no descriptor left."""


class Listener:
    """Listener at `path` from construction to `close`; `numbers` counts the connections of all
    doors. Raises ControlError if another daemon serves `path`, or the file cannot be made."""

    def __init__(self, path: Path, door: Door, numbers: Iterator[int]) -> None:
        self.path, self.door = path, door
        self._socket = listen(path, DOORS[door].group)
        file = path.stat()
        self._inode, self._group = file.st_ino, file.st_gid
        self._numbers, self._own_uid = numbers, os.getuid()
        self.silent_at = self.looked = 0  # polls without and with a client outside

    def fileno(self) -> int:
        """Descriptor that is readable while a client waits outside."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the listener, and remove the socket file if it is still this one's."""
        self._socket.close()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._inode:
                self.path.unlink()

    def next(self) -> Connection | None:
        """Connection of the next admitted client; None without one. Never waits. Raises
        NoDescriptorError if a client is outside, and no descriptor is left for it."""
        for _ in range(MOST_OUTSIDE):
            try:
                accepted, _ = self._socket.accept()
            except OSError as error:
                # The kernel looks for a descriptor before it looks for a client.
                if error.errno in (errno.EMFILE, errno.ENFILE) and self._client_waits():
                    raise NoDescriptorError from error
                return None  # gone again
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

    def _client_waits(self) -> bool:
        """True while a client waits outside."""
        looked = select.poll()
        looked.register(self._socket, select.POLLIN)
        return bool(looked.poll(0))

    def _admits(self, accepted: socket.socket, peer: Peer) -> bool:
        """True if the socket file's group, owner or root is at the other end."""
        try:
            return peer.uid in (0, self._own_uid) or self._group in groups_of(accepted)
        except OSError:  # an old kernel, or too many groups to list: the file's mode has decided
            return True
