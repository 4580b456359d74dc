"""What may happen on the bus beside samples: typed facts, judged elsewhere.

`str()` of one is what its type's name leaves to say, `told` puts the drive in front.
"""

import errno
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from drivers.emergency import emergency_words


@dataclass(frozen=True, slots=True)
class Emergency:
    """A drive's EMCY message: error code (0x603F; 0 is "no longer"), error register (0x1001)."""

    node: int
    code: int
    register: int

    def __str__(self) -> str:
        words = emergency_words(self.code)
        code = f"0x{self.code:04X}{words and f' ({words})'}"
        return f"{code}, error register 0x{self.register:02X}"


@dataclass(frozen=True, slots=True)
class HeartbeatLost:
    """No heartbeat of a drive for three of its periods; said once, until it is heard again."""

    node: int

    def __str__(self) -> str:
        return ""


@dataclass(frozen=True, slots=True)
class NotOperational:
    """A drive has left NMT operational (127 pre-operational, 4 stopped): its PDOs are off."""

    node: int
    nmt_state: int

    def __str__(self) -> str:
        return f"no longer operational (NMT state {self.nmt_state})"


@dataclass(frozen=True, slots=True)
class Disobedient:
    """A drive stays in operation although it is told to stop; it gets an NMT stop."""

    node: int

    def __str__(self) -> str:
        return "NMT stop sent"


@dataclass(frozen=True, slots=True)
class Unstoppable:
    """A drive stays in operation after the NMT stop, too."""

    node: int

    def __str__(self) -> str:
        return "goes on after an NMT stop, too"


@dataclass(frozen=True, slots=True)
class Rebooted:
    """A drive has started anew: it has forgotten its set-up."""

    node: int

    def __str__(self) -> str:
        return "its set-up is lost"


@dataclass(frozen=True, slots=True)
class ForeignMaster:
    """Somebody else sends what only the master may send."""

    cob_id: int

    def __str__(self) -> str:
        return f"it sends 0x{self.cob_id:03X}"


@dataclass(frozen=True, slots=True)
class BadSetpoint:
    """A target velocity that is not finite was refused; the drives were told to stop instead."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class LateAnswer:
    """A drive answered one SYNC twice: what was taken for the answer was that to the SYNC before,
    a whole period old."""

    node: int

    def __str__(self) -> str:
        return "answers later than a whole period"


@dataclass(frozen=True, slots=True)
class ErrorPassive:
    """The CAN controller has counted 128 errors: the bus still works, but badly."""

    def __str__(self) -> str:
        return "cable, termination, bitrate?"


@dataclass(frozen=True, slots=True)
class BusOff:
    """The CAN controller has taken itself off the bus."""

    def __str__(self) -> str:
        return ""


@dataclass(frozen=True, slots=True)
class AdapterGone:
    """The adapter, or the connection to it, is gone for good: this bus must be opened anew."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class BusTrouble:
    """Sending or receiving failed, or the controller reports an error; it may be over at once."""

    text: str

    def __str__(self) -> str:
        return self.text


BusEvent = LateAnswer | ErrorPassive | BusOff | AdapterGone | BusTrouble
Event = (
    Emergency
    | HeartbeatLost
    | NotOperational
    | Disobedient
    | Unstoppable
    | Rebooted
    | ForeignMaster
    | BadSetpoint
    | BusEvent
)


def told(event: Event, joints: Mapping[int, str]) -> str:
    """An event in words, for people who know their drives by joint; `joints`: of each node."""
    node = getattr(event, "node", None)
    if node is None:
        return str(event)
    drive = f"node {node} ({joints[node]})" if node in joints else f"node {node}"
    return ": ".join(filter(None, (drive, str(event))))


# A socket that said one of these does not come back, whatever becomes of the adapter. ENETDOWN is
# not among them: an interface that is set up again serves the sockets it had.
_GONE: Final = frozenset({errno.ENODEV, errno.ENXIO, errno.EBADF, errno.EIO, errno.ESHUTDOWN})


def bus_failure(doing: str, error: Exception) -> AdapterGone | BusTrouble:
    """What a failure of the bus means; `doing` is "sending" or "receiving"."""
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    # ValueError is what select() says of a socket that was closed.
    gone = isinstance(error, ConnectionError | ValueError) or number in _GONE
    text = f"{doing} failed: {error}"
    return AdapterGone(text) if gone else BusTrouble(text)


# Classes of Linux' error frames (linux/can/error.h), and where class 4 says what it means.
_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_PASSIVE: Final = 0x30  # data[1]: receiving or transmitting
_ERROR_CLASSES: Final = (
    (0x001, "transmission timed out"),
    (0x002, "arbitration lost"),
    (_CONTROLLER, "controller problem"),
    (0x008, "protocol violation"),
    (0x010, "transceiver trouble"),
    (0x020, "nobody acknowledges (is a drive powered, the bus terminated?)"),
    (_BUS_OFF, "bus off"),
    (0x080, "bus error"),
    (0x100, "controller restarted"),
)


def error_frame(error_class: int, data: bytes | bytearray) -> BusOff | ErrorPassive | BusTrouble:
    """What an error frame means; `error_class` is its identifier. An adapter that reports trouble
    of the controller without saying which (socketcand) is believed to mean error-passive."""
    if error_class & _BUS_OFF:
        return BusOff()
    if error_class & _CONTROLLER and (len(data) < 2 or data[1] & _PASSIVE):
        return ErrorPassive()
    found = [text for bit, text in _ERROR_CLASSES if error_class & bit]
    return BusTrouble("error frame: " + (", ".join(found) or f"class 0x{error_class:X}"))
