"""What may happen on the bus beside samples: typed facts, judged elsewhere."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Emergency:
    """A drive's EMCY message: error code (0x603F; 0 is "no longer"), error register (0x1001)."""

    node: int
    code: int
    register: int

    def __str__(self) -> str:
        return (
            f"node {self.node}: emergency 0x{self.code:04X}, error register 0x{self.register:02X}"
        )


@dataclass(frozen=True, slots=True)
class HeartbeatLost:
    """No heartbeat of a drive for three of its periods; said once, until it is heard again."""

    node: int

    def __str__(self) -> str:
        return f"node {self.node}: heartbeat lost"


@dataclass(frozen=True, slots=True)
class NotOperational:
    """A drive has left NMT operational (127 pre-operational, 4 stopped): its PDOs are off."""

    node: int
    nmt_state: int

    def __str__(self) -> str:
        return f"node {self.node}: no longer operational (NMT state {self.nmt_state})"


@dataclass(frozen=True, slots=True)
class Rebooted:
    """A drive has started anew: it has forgotten its set-up."""

    node: int

    def __str__(self) -> str:
        return f"node {self.node}: restarted, its set-up is lost"


@dataclass(frozen=True, slots=True)
class ForeignMaster:
    """Somebody else sends what only the master may send."""

    cob_id: int

    def __str__(self) -> str:
        return f"another master is on this bus: it sends 0x{self.cob_id:03X}"


@dataclass(frozen=True, slots=True)
class BadSetpoint:
    """A target velocity that is not finite was refused; the drives were told to stop instead."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class BusTrouble:
    """Sending or receiving failed, the connection is gone, or the controller reports errors."""

    text: str

    def __str__(self) -> str:
        return self.text


Event = (
    Emergency | HeartbeatLost | NotOperational | Rebooted | ForeignMaster | BadSetpoint | BusTrouble
)

# Classes of Linux' error frames (linux/can/error.h).
_ERROR_CLASSES: Final = (
    (0x001, "transmission timed out"),
    (0x002, "arbitration lost"),
    (0x004, "controller problem"),
    (0x008, "protocol violation"),
    (0x010, "transceiver trouble"),
    (0x020, "nobody acknowledges (is a drive powered, the bus terminated?)"),
    (0x040, "bus off"),
    (0x080, "bus error"),
    (0x100, "controller restarted"),
)


def error_frame_text(error_class: int) -> str:
    """Words for an error frame; `error_class` is its identifier."""
    found = [text for bit, text in _ERROR_CLASSES if error_class & bit]
    return "error frame: " + (", ".join(found) or f"class 0x{error_class:X}")
