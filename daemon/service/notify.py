"""Reports to systemd on the state of the service (sd_notify(3)): datagrams to $NOTIFY_SOCKET.

Nothing here waits. A datagram that the socket does not take is kept, and tried again after the next
tick.
"""

import logging
import math
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager

# The watchdog is fed this many times within its timeout.
FEEDS_PER_TIMEOUT = 4
# As `TimeoutStartSec=` of the unit.
RELOAD_S = 60.0

_FEED = b"WATCHDOG=1"
_log = logging.getLogger("contactd")


class Notifier:
    """Connection of one service to its manager; without one (`address` empty) nothing is sent."""

    def __init__(self, address: str = "", watchdog_s: float = 0.0) -> None:
        """`address` as in $NOTIFY_SOCKET: a path, or @ and an abstract name."""
        self.feed_every_s = watchdog_s / FEEDS_PER_TIMEOUT
        self._watchdog_s = watchdog_s
        self._fed_s = -math.inf
        self._address = _socket_address(address)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        # Not yet taken by the socket; a later status overrides an earlier one.
        self._state = self._status = b""
        self._failing = False

    def ready(self, status: str) -> None:
        """Report that the start is complete: units that wait for this service may start."""
        self._notify(b"READY=1\n" + self._timeout(self._watchdog_s), status)

    def reloading(self, status: str, now_s: float) -> None:
        """Report that a new start has begun (`now_s` monotonic). The watchdog's timeout is extended
        to that of the first start, as no tick feeds it meanwhile."""
        now = f"RELOADING=1\nMONOTONIC_USEC={round(1e6 * now_s)}\n"
        self._notify(now.encode() + self._timeout(RELOAD_S), status)

    def status(self, text: str) -> None:
        """Report one line for `systemctl status`."""
        self._notify(self._state, text)

    def stopping(self, status: str) -> None:
        """Report that the shutdown has begun."""
        self._notify(b"STOPPING=1\n", status)

    def ticked(self, now_s: float) -> None:
        """Feed the watchdog after a tick, if it is due (`now_s` monotonic)."""
        if self._status:
            self._flush()
        if 0.0 < self.feed_every_s <= now_s - self._fed_s and self._send(_FEED):
            self._fed_s = now_s

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _timeout(self, seconds: float) -> bytes:
        return f"WATCHDOG_USEC={round(1e6 * seconds)}\n".encode() if self._watchdog_s else b""

    def _notify(self, state: bytes, status: str) -> None:
        # A line break in a status would begin another assignment.
        self._state, self._status = state, f"STATUS={' '.join(status.split())}".encode()
        self._flush()

    def _flush(self) -> None:
        if self._send(self._state + self._status):
            self._state = self._status = b""

    def _send(self, message: bytes) -> bool:
        """Send; True if it was sent, or if there is no manager."""
        if not self._address:
            return True
        try:
            self._socket.sendto(message, self._address)
        except OSError as error:
            if not self._failing:
                _log.warning("systemd does not take a notification: %s", error.strerror)
            self._failing = True
            return False
        self._failing = False
        return True


def notifier_of(environment: Mapping[str, str], pid: int) -> Notifier:
    """Notifier for the socket that systemd offers process `pid` in its environment, if any."""
    address = environment.get("NOTIFY_SOCKET", "")
    watched = environment.get("WATCHDOG_PID", str(pid)) == str(pid)
    usec = environment.get("WATCHDOG_USEC", "")
    return Notifier(address, int(usec) / 1e6 if watched and usec.isdecimal() else 0.0)


@contextmanager
def failure_reported(environment: Mapping[str, str], pid: int) -> Iterator[None]:
    """Report an error that ends process `pid` as its status: `systemctl status` shows it until the
    next start, whatever is logged after it."""
    try:
        yield
    except Exception as error:
        with closing(notifier_of(environment, pid)) as notifier:
            notifier.status(f"failed: {str(error) or type(error).__name__}")
        raise


def _socket_address(address: str) -> bytes:
    """Address of an AF_UNIX socket; empty without one, and for other kinds (vsock:...)."""
    if address.startswith("@"):
        return b"\0" + os.fsencode(address[1:])
    if address.startswith("/") or not address:
        return os.fsencode(address)
    _log.warning("NOTIFY_SOCKET=%s is not a local socket: systemd is not notified", address)
    return b""
