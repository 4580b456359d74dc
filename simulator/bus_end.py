"""Connection of the simulated drives to a CAN bus that may disappear and return."""

import errno
import time
from collections.abc import Callable

import can

from common.errors import BusError

FAILURES = (can.CanError, OSError, ValueError)
REOPEN_S = 0.2


class BusEnd:
    """Connection to a bus, reopened after a loss.

    Raises BusError if the bus is missing at the start.
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
        """Send a frame; it is dropped without a bus, or if the transmit queue is full."""
        if self._bus is None:
            return
        try:
            self._bus.send(message)
        except FAILURES as error:
            if getattr(error, "error_code", None) != errno.ENOBUFS:
                self._lose(error)

    def receive(self, timeout: float) -> can.Message | None:
        """Next frame, or None after `timeout` s."""
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
            bus.recv(0.0)  # an interface that is down can be opened, but raises here
        except FAILURES:
            if bus is not None:
                bus.shutdown()
            return
        self._bus = bus
        self._report(f"on {self._name} again")
