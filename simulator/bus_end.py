"""The drives' end of a CAN bus that may go and come back: drives have power of their own."""

import errno
import time
from collections.abc import Callable

import can

from common.errors import BusError

FAILURES = (can.CanError, OSError, ValueError)
REOPEN_S = 0.2


class BusEnd:
    """Connection to a bus that is waited for while there is none.

    Raises BusError if there is none at the beginning.
    """

    def __init__(self, interface: str, channel: str, report: Callable[[str], None]) -> None:
        self._name, self._open = f"{interface} {channel}", (interface, channel)
        self._report = report
        self._tried_s = 0.0
        try:
            self._bus: can.BusABC | None = can.Bus(interface=interface, channel=channel)
        except FAILURES as error:
            raise BusError(f"no CAN bus {self._name}: {error}") from error
        report(f"on {self._name}")

    def send(self, message: can.Message) -> None:
        """Put a frame on the bus; it is lost where there is none, or no room on it."""
        if self._bus is None:
            return
        try:
            self._bus.send(message)
        except FAILURES as error:
            if getattr(error, "error_code", None) != errno.ENOBUFS:
                self._lose(error)

    def receive(self, timeout: float) -> can.Message | None:
        """The next frame, or None after `timeout` s."""
        if self._bus is None:
            time.sleep(timeout)
            self._reopen()
            return None
        try:
            return self._bus.recv(timeout)
        except FAILURES as error:
            self._lose(error)
            return None

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _lose(self, error: Exception) -> None:
        self.close()
        self._report(f"bus lost: {error}")

    def _reopen(self) -> None:
        now = time.monotonic()
        if now - self._tried_s < REOPEN_S:
            return
        self._tried_s = now
        interface, channel = self._open
        bus = None
        try:
            bus = can.Bus(interface=interface, channel=channel)
            bus.recv(0.0)  # an interface that is down can be opened, and says so here
        except FAILURES:
            if bus is not None:
                bus.shutdown()
            return
        self._bus = bus
        self._report(f"on {self._name} again")
