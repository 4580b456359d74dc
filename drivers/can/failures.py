"""Events for bus failures: exceptions of the interface, and error frames of the controller."""

import errno
from typing import Final

from drivers.api import Event, Kind

# A socket that raised one of these never recovers, even if the adapter returns. ENETDOWN is not
# among them: an interface that is brought up again serves its existing sockets.
_GONE: Final = frozenset({errno.ENODEV, errno.ENXIO, errno.EBADF, errno.EIO, errno.ESHUTDOWN})


def bus_failure(doing: str, error: Exception) -> Event:
    """Event for an exception of the interface; `doing` is "sending" or "receiving"."""
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    # select() raises ValueError for a socket that was closed.
    gone = isinstance(error, ConnectionError | ValueError) or number in _GONE
    kind = Kind.ADAPTER_GONE if gone else Kind.DISTURBED
    return Event(kind, f"{doing} failed: {error}")


# Error classes of Linux error frames (linux/can/error.h), and the detail bits of class 4.
_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_PASSIVE: Final = 0x30  # data[1]: receiving or transmitting
_ERROR_CLASSES: Final = (
    (0x001, "transmission timed out"),
    (0x002, "arbitration lost"),
    (_CONTROLLER, "controller problem"),
    (0x008, "protocol violation"),
    (0x010, "transceiver trouble"),
    (0x020, "no node acknowledges (is a drive powered, the bus terminated?)"),
    (_BUS_OFF, "bus off"),
    (0x080, "bus error"),
    (0x100, "controller restarted"),
)


def error_frame(error_class: int, data: bytes | bytearray) -> Event:
    """Event for an error frame; `error_class` is its identifier. A controller problem reported
    without detail (socketcand) is taken to be error-passive."""
    if error_class & _BUS_OFF:
        return Event(Kind.OFF_BUS, "")
    if error_class & _CONTROLLER and (len(data) < 2 or data[1] & _PASSIVE):
        return Event(Kind.PASSIVE, "cable, termination, bitrate?")
    found = [text for bit, text in _ERROR_CLASSES if error_class & bit]
    words = ", ".join(found) or f"class 0x{error_class:X}"
    return Event(Kind.DISTURBED, f"error frame: {words}")
