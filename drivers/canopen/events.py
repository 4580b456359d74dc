"""Events on the bus beside the samples: typed facts. `crossing` names them for the daemon.

`str()` of one is its detail, without the name of its type.
"""

from dataclasses import dataclass
from enum import StrEnum

from drivers.canopen.emergency_codes import UNKNOWN_CODE, emergency_words


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
