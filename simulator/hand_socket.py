"""Socket of the simulator's hand: acts requested while it runs.

A client connects, sends one act as a line of JSON and reads one line back, `{"ok": ..., "text":
...}`. This socket belongs to the simulator alone: nothing passes through the daemon, which must
detect the hand by itself. Only the user who runs the simulator may connect.
"""

import contextlib
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import msgspec

from common.errors import BusError, ConfigurationError
from simulator.hand_script import AnyAct

LONGEST = 4096
TIMEOUT_S = 0.05
"""Longest wait for a client that connects and sends nothing."""


class HandSocket:
    """Listening socket at a path. `serve` does not block without a connected client."""

    def __init__(self, path: Path) -> None:
        """Raises BusError if another simulator listens, the path is a file that is no socket, or
        the socket cannot be created."""
        self.path = path
        if _alive(path):
            raise BusError(f"another simulator listens for a hand at {path}")
        with contextlib.suppress(OSError):
            if not stat.S_ISSOCK(path.lstat().st_mode):
                raise BusError(f"cannot listen for a hand at {path}: it exists and is not a socket")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            path.unlink(missing_ok=True)
            os.fchmod(self._socket.fileno(), 0o600)
            self._socket.bind(str(path))
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise BusError(f"cannot listen for a hand at {path}: {error}") from error
        self._socket.setblocking(False)

    def serve(self, take: Callable[[AnyAct], str]) -> None:
        """Take the acts of all connected clients. take: begins an act and returns it as text, or
        raises ConfigurationError."""
        with contextlib.suppress(BlockingIOError):
            while True:
                connection, _ = self._socket.accept()
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(TIMEOUT_S)
                    connection.sendall(
                        msgspec.json.encode(_answer(_line(connection), take)) + b"\n"
                    )

    def close(self) -> None:
        """Close the socket and remove its file."""
        self._socket.close()
        self.path.unlink(missing_ok=True)


def _answer(line: bytes, take: Callable[[AnyAct], str]) -> dict[str, object]:
    try:
        act = msgspec.json.decode(line, type=AnyAct)
        return {"ok": True, "text": take(act)}
    except (msgspec.MsgspecError, ConfigurationError, UnicodeDecodeError) as error:
        return {"ok": False, "text": str(error)}


def _line(connection: socket.socket) -> bytes:
    data = b""
    while b"\n" not in data and len(data) < LONGEST and (more := connection.recv(LONGEST)):
        data += more
    return data.partition(b"\n")[0]


def _alive(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
        return True
