"""Scan of a bus for RobStride motors: reads unique numbers and parameters, without commands."""

import math
from dataclasses import dataclass
from typing import Final

from drivers.can.wire import Wire
from drivers.motors.queries import received_frames
from drivers.motors.scan import scanned
from drivers.robstride.frames import (
    Kind,
    Parameter,
    get_id,
    kind_of,
    read,
    read_value,
    sender_of,
    uid_of,
)

#: Answer timeout of one motor [s].
ANSWER_S: Final = 0.02
IDS: Final = range(1, 128)
COMMANDS: Final = frozenset({Kind.SETPOINT, Kind.ENABLE, Kind.STOP, Kind.WRITE})
_READ: Final = (
    Parameter.MODE, Parameter.TORQUE_LIMIT, Parameter.POSITION, Parameter.SUPPLY,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FoundMotor:
    """Motor that answered, the unique numbers of all motors with its ID, and parameters; NaN for
    those that it did not answer."""

    motor: int
    uids: tuple[int, ...]
    values: dict[Parameter, float]


def scan_motors(wire: Wire) -> list[FoundMotor]:
    """Motors that answer. Raises BusError if a master commands motors, or the bus fails."""
    return scanned(wire, IDS, lambda can_id: kind_of(can_id) in COMMANDS, _found)


def _found(wire: Wire, motor: int) -> FoundMotor | None:
    wire.send([get_id(motor)])
    uids = tuple(
        uid_of(data)
        for can_id, data in received_frames(wire, ANSWER_S)
        if kind_of(can_id) == Kind.GET_ID and sender_of(can_id) == motor and len(data) == 8
    )
    if not uids:
        return None
    return FoundMotor(motor, uids, {each: _value(wire, motor, each) for each in _READ})


def _value(wire: Wire, motor: int, parameter: Parameter) -> float:
    """Value of a parameter; NaN without an answer."""
    value = math.nan
    wire.send([read(motor, parameter)])
    for can_id, data in received_frames(wire, ANSWER_S):
        if kind_of(can_id) == Kind.READ and sender_of(can_id) == motor:
            found = read_value(parameter, can_id, data)
            value = value if found is None else found
    return value
