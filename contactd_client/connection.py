"""Blocking connection to a daemon's socket; each packet is one JSON message."""

import select
import socket
import time
from pathlib import Path
from typing import Final

from contactd_client.errors import ClosedError, ControlError, UnreachableError
from contactd_client.paths import why_unreachable

# More than fits into the daemon's socket (twice its send buffer).
MAX_PACKET_BYTES: Final = 2 << 20
ANSWER_S: Final = 2.0
# These read back all drives before they answer, and drives that are set up again may have to boot.
SLOW_COMMANDS: Final = frozenset({"enable", "reset"})
SLOW_TIMEOUT_S: Final = 30.0

_RETRY_S = 0.0003  # retry interval if the daemon's backlog is full


def command_timeout_s(command: str, timeout_s: float) -> float:
    """Answer timeout of `command` [s]."""
    return max(SLOW_TIMEOUT_S, timeout_s) if command in SLOW_COMMANDS else timeout_s


class Connection:
    """One connection, from construction to `close`.

    Raises UnreachableError if there is no daemon, this user has no access, or it does not answer
    within `timeout_s` [s].
    """

    def __init__(self, path: Path, timeout_s: float = ANSWER_S) -> None:
        self._timeout_s = timeout_s
        self._socket = _connect(path, timeout_s)
        self._buffer = bytearray(MAX_PACKET_BYTES)

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def send(self, request: bytes) -> None:
        """Send a request whose answer is read later, by `packet`."""
        try:
            self._socket.send(request)
        except TimeoutError:
            raise UnreachableError("the daemon is silent: it reads no requests") from None
        except OSError as error:
            raise ClosedError(f"the daemon closed the connection ({error.strerror})") from None

    def exchange(self, request: bytes, timeout_s: float) -> bytes:
        """Send a request and wait for its answer, at most `timeout_s` [s]. After a timeout the
        connection is closed."""
        if self._socket.fileno() < 0:
            raise UnreachableError("the daemon has ended or was silent: connect again")
        self._socket.settimeout(timeout_s)
        try:
            self._socket.send(request)
        except (BrokenPipeError, ConnectionResetError):
            pass  # the daemon may have sent a reason before it closed: read on
        except TimeoutError:
            raise UnreachableError("the daemon is silent: it reads no requests") from None
        try:
            answer = self.packet("does not answer; is it still starting?")
        except UnreachableError:
            # A late answer would be mistaken for that to the next request.
            self.close()
            raise
        self._socket.settimeout(self._timeout_s)
        return answer

    def waits(self, timeout_s: float) -> bool:
        """True once a message or the end of the connection can be read; False if neither arrives
        within `timeout_s` [s]."""
        poll = select.poll()
        poll.register(self._socket, select.POLLIN)
        return bool(poll.poll(1e3 * timeout_s))

    def packet(self, silence: str = "fell silent") -> bytes:
        """Next message, undecoded. Raises UnreachableError "the daemon {silence}" on timeout,
        ClosedError if the daemon closed the connection, ControlError for an oversized message."""
        try:
            try:
                size, _, flags, _ = self._socket.recvmsg_into([self._buffer])
            except ConnectionResetError:
                # Raised once, ahead of messages that the daemon sent before it closed.
                size, _, flags, _ = self._socket.recvmsg_into([self._buffer])
        except TimeoutError:
            raise UnreachableError(f"the daemon {silence}") from None
        except OSError as error:
            raise ClosedError(f"the daemon closed the connection ({error.strerror})") from None
        if size == 0:
            raise ClosedError("the daemon closed the connection")
        if flags & socket.MSG_TRUNC:
            raise ControlError(f"the daemon sent more than {MAX_PACKET_BYTES} bytes at once")
        return bytes(memoryview(self._buffer)[:size])


def _connect(path: Path, timeout_s: float) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    connection.settimeout(timeout_s)
    deadline = time.monotonic() + timeout_s
    try:
        while True:
            try:
                connection.connect(str(path))
            except BlockingIOError:  # its backlog is full
                if time.monotonic() > deadline:
                    raise TimeoutError from None
                time.sleep(_RETRY_S)
            else:
                return connection
    except OSError as error:
        connection.close()
        raise UnreachableError(why_unreachable(path, error)) from error
