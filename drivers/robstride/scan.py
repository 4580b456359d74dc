"""Scan of a bus for RobStride motors: their numbers and parameters, and no command."""

import math
from dataclasses import dataclass
from typing import Final

from drivers.can.wire import Wire
from drivers.motors.queries import heard
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

#: Time for the answer of one motor [s].
ANSWER_S: Final = 0.02
IDS: Final = range(1, 128)
COMMANDS: Final = frozenset({Kind.SETPOINT, Kind.ENABLE, Kind.STOP, Kind.WRITE})
_READ: Final = (
    Parameter.MODE, Parameter.TORQUE_LIMIT, Parameter.POSITION, Parameter.SUPPLY,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FoundMotor:
    """Motor that answered, the numbers of those with its id, and parameters; NaN where it did not
    answer about one."""

    motor: int
    uids: tuple[int, ...]
    values: dict[Parameter, float]


def scan_motors(wire: Wire) -> list[FoundMotor]:
    """Motors that answer. Raises BusError where a master commands some, or the bus fails."""
    return scanned(wire, IDS, lambda can_id: kind_of(can_id) in COMMANDS, _found)


def _found(wire: Wire, motor: int) -> FoundMotor | None:
    wire.send([get_id(motor)])
    uids = tuple(
        uid_of(data)
        for can_id, data in heard(wire, ANSWER_S)
        if kind_of(can_id) == Kind.GET_ID and sender_of(can_id) == motor and len(data) == 8
    )
    if not uids:
        return None
    return FoundMotor(motor, uids, {each: _value(wire, motor, each) for each in _READ})


def _value(wire: Wire, motor: int, parameter: Parameter) -> float:
    """Value of a parameter; NaN where no motor answers."""
    value = math.nan
    wire.send([read(motor, parameter)])
    for can_id, data in heard(wire, ANSWER_S):
        if kind_of(can_id) == Kind.READ and sender_of(can_id) == motor:
            found = read_value(parameter, can_id, data)
            value = value if found is None else found
    return value
