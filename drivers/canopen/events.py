"""Events on the bus beside the samples: typed facts, judged elsewhere.

`str()` of one is its detail, without the name of its type; `described` puts the drive in front.
Error codes of an EMCY message are put in words after CiA 301, 7.2.7.1, and CiA 402-2, annex of
error codes.
"""

import errno
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

#: Kinds of emergency codes (CiA 301): of communication, after which some drives take a reset only
#: when set up again; and of the frames that were sent to them.
COMMUNICATION_ERROR: Final = 0x8100
PROTOCOL_ERROR: Final = 0x8200
#: A drive misses our heartbeat.
MASTER_SILENT: Final = 0x8130
OF_COMMUNICATION: Final = frozenset({COMMUNICATION_ERROR, PROTOCOL_ERROR})
#: Code of a message that is too short to have one.
UNKNOWN_CODE: Final = -1


@dataclass(frozen=True, slots=True)
class Emergency:
    """A drive's EMCY message: error code (0x603F; 0 is "no longer"), error register (0x1001)."""

    node: int
    code: int
    register: int

    def __str__(self) -> str:
        if self.code == UNKNOWN_CODE:
            return "of unknown code, the message is cut short"
        words = emergency_words(self.code)
        code = f"0x{self.code:04X}{words and f' ({words})'}"
        return f"{code}, error register 0x{self.register:02X}"


@dataclass(frozen=True, slots=True)
class HeartbeatLost:
    """No heartbeat of a drive for three of its periods; reported once, until it is heard again."""

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


class RunningOn(StrEnum):
    """Way in which a drive disobeys a command to stop, and the reaction to it."""

    UNHEARD = "NMT stop sent"
    MOVES = "it reports that it stops, but moves on"
    BEYOND = "it reports that it stops, but moves on beyond its travel: power cut"


@dataclass(frozen=True, slots=True)
class NotSeenToStop:
    """Drives were commanded to stop, by setpoint and by SDO, and nothing confirms that they do; or
    they report it, but move as if they did not."""

    nodes: tuple[int, ...]
    how: RunningOn = RunningOn.UNHEARD

    def __str__(self) -> str:
        return self.how.value


@dataclass(frozen=True, slots=True)
class Repeats:
    """All samples of these drives repeat to the last bit while their motors move, or were commanded
    to: they were not measured."""

    nodes: tuple[int, ...]

    def __str__(self) -> str:
        return "all of its samples repeat while its motor moves, or was commanded to"


@dataclass(frozen=True, slots=True)
class Unproved:
    """Nothing confirms that these drives stop after the NMT stop either; we fall silent."""

    nodes: tuple[int, ...]

    def __str__(self) -> str:
        return "no heartbeat of ours any more"


@dataclass(frozen=True, slots=True)
class Absent:
    """The drives heard nothing of us for so long that they may have stopped by themselves."""

    seconds: float

    def __str__(self) -> str:
        return f"the drives heard nothing of it for {1000 * self.seconds:.0f} ms"


@dataclass(frozen=True, slots=True)
class Rebooted:
    """A drive has started anew: it has forgotten its set-up."""

    node: int

    def __str__(self) -> str:
        return "its set-up is lost"


@dataclass(frozen=True, slots=True)
class ForeignMaster:
    """Another node sends what only the master may send."""

    cob_id: int

    def __str__(self) -> str:
        return f"it sends 0x{self.cob_id:03X}"


@dataclass(frozen=True, slots=True)
class BadSetpoint:
    """A target velocity that is not finite was refused; the drives get a quick stop instead."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class LateAnswer:
    """A drive answered one SYNC twice: the first was the answer to the SYNC before, a whole period
    old."""

    node: int

    def __str__(self) -> str:
        return "answers later than a whole period"


@dataclass(frozen=True, slots=True)
class OldAnswers:
    """Drives answer every SYNC a period late, so that their samples are old: they answered when no
    SYNC was sent."""

    nodes: tuple[int, ...]

    def __str__(self) -> str:
        return "it answers when no SYNC is sent"


@dataclass(frozen=True, slots=True)
class TwoDrives:
    """Every SYNC, or SDO, is answered twice: another drive has the same node number."""

    nodes: tuple[int, ...]

    def __str__(self) -> str:
        return "two drives answer as this node"


@dataclass(frozen=True, slots=True)
class BusLoaded:
    """Too much of the bus is taken, by frames of others beside those of the arm."""

    load: float  # share of the bus, at least
    unknown_hz: float  # frames of unknown senders, per second
    most: int | None  # identifier of the most of these, if one stands out

    def __str__(self) -> str:
        unknown = f", {self.unknown_hz:.0f} unknown frames/s" if self.unknown_hz else ""
        most = "" if self.most is None else f", 0x{self.most:03X} among them"
        return f"at least {self.load:.0%} of the bus is taken{unknown}{most}".replace("%", " %")


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


BusEvent = (
    Emergency
    | HeartbeatLost
    | NotOperational
    | NotSeenToStop
    | Repeats
    | Unproved
    | Absent
    | Rebooted
    | ForeignMaster
    | BadSetpoint
    | LateAnswer
    | OldAnswers
    | TwoDrives
    | BusLoaded
    | ErrorPassive
    | BusOff
    | AdapterGone
    | BusTrouble
)


def described(event: BusEvent, joints: Mapping[int, str]) -> str:
    """Text of an event, with the joint of each drive; `joints`: names by node."""
    nodes = getattr(event, "nodes", None) or (getattr(event, "node", None),)
    drives = ", ".join(
        f"node {node} ({joints[node]})" if node in joints else f"node {node}"
        for node in nodes
        if node is not None
    )
    return ": ".join(filter(None, (drives, str(event))))


# A socket that raised one of these does not come back, whatever becomes of the adapter. ENETDOWN is
# not among them: an interface that is set up again serves the sockets it had.
_GONE: Final = frozenset({errno.ENODEV, errno.ENXIO, errno.EBADF, errno.EIO, errno.ESHUTDOWN})


def bus_failure(doing: str, error: Exception) -> AdapterGone | BusTrouble:
    """Event for a failure of the bus; `doing` is "sending" or "receiving"."""
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    # select() raises ValueError for a socket that was closed.
    gone = isinstance(error, ConnectionError | ValueError) or number in _GONE
    text = f"{doing} failed: {error}"
    return AdapterGone(text) if gone else BusTrouble(text)


# Classes of Linux' error frames (linux/can/error.h), and the bits that detail class 4.
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


def error_frame(error_class: int, data: bytes | bytearray) -> BusOff | ErrorPassive | BusTrouble:
    """Event for an error frame; `error_class` is its identifier. An adapter that reports trouble of
    the controller without detail (socketcand) is taken to mean error-passive."""
    if error_class & _BUS_OFF:
        return BusOff()
    if error_class & _CONTROLLER and (len(data) < 2 or data[1] & _PASSIVE):
        return ErrorPassive()
    found = [text for bit, text in _ERROR_CLASSES if error_class & bit]
    return BusTrouble("error frame: " + (", ".join(found) or f"class 0x{error_class:X}"))


_WORDS: Final = {
    0x2310: "over-current",
    0x2320: "short circuit",
    0x2330: "leakage to earth",
    0x2340: "short circuit of the motor",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3130: "mains phase missing",
    0x3210: "DC link over-voltage",
    0x3220: "DC link under-voltage",
    0x4210: "over-temperature of the drive",
    0x4310: "over-temperature of the motor",
    0x5112: "logic supply too low",
    0x7121: "motor blocked",
    0x7305: "motor encoder",
    0x7306: "second encoder",
    0x8110: "CAN overrun, frames lost",
    0x8120: "CAN error-passive",
    0x8130: "heartbeat of the master lost",
    0x8140: "recovered from bus-off",
    0x8150: "COB-ID used twice",
    0x8210: "PDO too short",
    0x8220: "PDO too long",
    0x8611: "following error",
}

# Where a code is not in the table, its first digits still give its kind.
_KINDS: Final = (
    (0xFF00, 0x2100, "current, input side"),
    (0xFF00, 0x2200, "current inside the drive"),
    (0xFF00, 0x2300, "current, output side"),
    (0xF000, 0x2000, "current"),
    (0xFF00, 0x3100, "mains voltage"),
    (0xFF00, 0x3200, "DC link voltage"),
    (0xFF00, 0x3300, "output voltage"),
    (0xF000, 0x3000, "voltage"),
    (0xFF00, 0x4100, "temperature of the surroundings"),
    (0xFF00, 0x4200, "temperature of the drive"),
    (0xFF00, 0x4300, "temperature of the motor"),
    (0xF000, 0x4000, "temperature"),
    (0xF000, 0x5000, "hardware of the drive"),
    (0xF000, 0x6000, "software of the drive"),
    (0xFF00, 0x7300, "a sensor"),
    (0xF000, 0x7000, "a module of the drive"),
    (0xFF00, 0x8100, "communication"),
    (0xFF00, 0x8200, "protocol"),
    (0xFF00, 0x8300, "torque control"),
    (0xFF00, 0x8400, "velocity control"),
    (0xFF00, 0x8500, "position control"),
    (0xF000, 0x8000, "monitoring"),
    (0xF000, 0x9000, "an external error"),
    (0xFF00, 0xFF00, "specific to the drive, see its manual"),
    (0xF000, 0xF000, "additional function"),
    (0xF000, 0x1000, "generic error"),
    (0xFF00, 0x0000, "no longer"),
)


def emergency_words(code: int) -> str:
    """Words for an error code (0x603F); empty for one that no standard defines."""
    if words := _WORDS.get(code):
        return words
    return next((words for mask, kind, words in _KINDS if code & mask == kind), "")
