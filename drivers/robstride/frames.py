"""Frames of RobStride motors: commands, feedback and parameters, as bytes. Pure.

An identifier has 29 bits: type in bits 28 to 24, data in 23 to 8, address in 7 to 0. A motor
answers each command and each written parameter with a feedback. Feedback values are 16-bit,
big-endian, and span -MAX to +MAX; parameters are little-endian. Values are from the manufacturer's
manuals and samples; docs/drives.md lists the sources.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from drivers.can.wire import EXTENDED, Frame

#: Our address, as in the manual. To which address a motor answers a setpoint is not published.
HOST: Final = 0xFD

_FOUR: Final = struct.Struct(">HHHH")
_FLOAT: Final = struct.Struct("<f")
_WORD: Final = struct.Struct("<I")
_EMPTY: Final = bytes(8)


class Kind(IntEnum):
    """Frame types in use."""

    GET_ID = 0
    SETPOINT = 1  # torque = kp (p - q) + kd (v - q_dot) + t, with t in the identifier
    FEEDBACK = 2
    ENABLE = 3
    STOP = 4  # with a first byte of 1 it also clears faults
    ZERO = 6  # sets the present position to 0
    READ = 17
    WRITE = 18
    FAULTS = 21


class Parameter(IntEnum):
    """Parameters in use; the same in every model."""

    MODE = 0x7005  # one byte
    TORQUE_LIMIT = 0x700B  # [Nm]
    POSITION = 0x7019  # of the rotor behind the gear, multi-turn [rad]
    SUPPLY = 0x701C  # [V]
    TIMEOUT = 0x7028  # in TIMEOUT_S, 0 is none; write-only in some models


TIMEOUT_S: Final = 50e-6
IMPEDANCE_MODE: Final = 0
RUN: Final = 2
"""Mode in a feedback in which the motor has torque; 0 is reset, 1 is calibration."""


class Fault(IntFlag):
    """Fault bits of a feedback."""

    UNDERVOLTAGE = 1
    OVERCURRENT = 2
    OVERHEATED = 4
    ENCODER = 8
    OVERLOAD = 16  # a Hall sensor fault according to older clients
    UNCALIBRATED = 32


def identifier(kind: int, data: int, address: int) -> int:
    """Identifier of a frame, with the Linux flag."""
    return EXTENDED | kind << 24 | data << 8 | address


def get_id(motor: int) -> Frame:
    """Request for a motor's unique number."""
    return identifier(Kind.GET_ID, HOST, motor), _EMPTY


def enable(motor: int) -> Frame:
    """Command that enables a motor."""
    return identifier(Kind.ENABLE, HOST, motor), _EMPTY


def stop(motor: int) -> Frame:
    """Command that disables a motor."""
    return identifier(Kind.STOP, HOST, motor), _EMPTY


def clear(motor: int) -> Frame:
    """Command that clears a motor's faults."""
    return identifier(Kind.STOP, HOST, motor), b"\x01" + bytes(7)


def read(motor: int, parameter: Parameter) -> Frame:
    """Request to read a parameter."""
    return identifier(Kind.READ, HOST, motor), parameter.to_bytes(8, "little")


def write(motor: int, parameter: Parameter, value: float) -> Frame:
    """Request to write a parameter; the value is lost when the motor's power is off."""
    raw = _FLOAT.pack(value) if parameter not in _WHOLE else _WORD.pack(int(value))
    return identifier(Kind.WRITE, HOST, motor), parameter.to_bytes(4, "little") + raw


_WHOLE: Final = frozenset({Parameter.MODE, Parameter.TIMEOUT})


def setpoint_id(motor: int) -> int:
    """Identifier of a setpoint without feedforward torque."""
    return identifier(Kind.SETPOINT, 0x7FFF, motor)


def setpoint(data: bytearray, position: int, velocity: int, gains: tuple[int, int]) -> None:
    """Pack position, velocity, stiffness and damping of a setpoint, 16 bits each."""
    _FOUR.pack_into(data, 0, position, velocity, *gains)


def fields_of(data: bytes | bytearray) -> tuple[int, int, int, int]:
    """Four values of a setpoint or a feedback. Raises struct.error for fewer than eight bytes."""
    return _FOUR.unpack_from(data)


def kind_of(can_id: int) -> int:
    """Type of a frame; -1 for an 11-bit identifier."""
    return can_id >> 24 & 0x1F if can_id & EXTENDED else -1


def sender_of(can_id: int) -> int:
    """Motor that sent an answer."""
    return can_id >> 8 & 0xFF


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback in counts; 0 corresponds to -MAX."""

    code: int  # mode in the upper two bits, faults below
    position: int
    velocity: int
    torque: int
    degC: float  # of the winding


def feedback_of(can_id: int, data: bytes | bytearray) -> Feedback:
    """Feedback from eight bytes. Raises struct.error for fewer."""
    position, velocity, torque, tenths = _FOUR.unpack_from(data)
    return Feedback(can_id >> 16 & 0xFF, position, velocity, torque, 0.1 * tenths)


def mode_of(code: int) -> int:
    """Mode of a feedback."""
    return code >> 6


def faults_of(code: int) -> Fault:
    """Faults of a feedback."""
    return Fault(code & 0x3F)


def read_value(parameter: Parameter, can_id: int, data: bytes | bytearray) -> float | None:
    """Value in the answer to a read of this parameter; None for other answers, or if the motor has
    no such parameter."""
    if len(data) < 8 or can_id >> 16 & 0xFF or int.from_bytes(data[:2], "little") != parameter:
        return None
    value: float = (_WORD if parameter in _WHOLE else _FLOAT).unpack_from(data, 4)[0]
    return int(value) & 0xFF if parameter is Parameter.MODE else value


def uid_of(data: bytes | bytearray) -> int:
    """Unique 64-bit number of a motor's controller."""
    return int.from_bytes(data[:8], "little")
