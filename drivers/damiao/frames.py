"""Frames of Damiao motors: commands, feedback and registers, as bytes. Pure.

A motor answers each command frame with one feedback frame, under its master ID. Integers of 16 and
12 bits span -MAX to +MAX; floats are IEEE 754, little-endian. Values are from the manufacturer's
manuals and samples; docs/drives.md lists the sources.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.can.wire import Frame

REGISTERS: Final = 0x7FF
ANSWERS: Final = 0x10  # usual offset of the master ID from the motor's ID

_COMMAND: Final = b"\xff" * 7
ENABLE: Final = _COMMAND + b"\xfc"
DISABLE: Final = _COMMAND + b"\xfd"
CLEAR_ERROR: Final = _COMMAND + b"\xfb"

_READ, _WRITE, _REFRESH = 0x33, 0x55, 0xCC
_FLOAT: Final = struct.Struct("<f")
_SETPOINT: Final = struct.Struct(">HBBBBBB")
#: Full scale of 12 bits of stiffness [Nm/rad] and of damping [Nm s/rad], in every model.
STIFFEST, MOST_DAMPING = 500.0, 5.0
_WORD: Final = struct.Struct("<I")
#: Status and ID; position, velocity and torque in 40 bits; two temperatures.
_FEEDBACK: Final = struct.Struct(">BHBBBBB")


class Register(IntEnum):
    """Registers in use."""

    ACCELERATION = 4
    DECELERATION = 5
    MASTER_ID = 7
    ID = 8
    TIMEOUT = 9  # in TIMEOUT_S; 0 is none
    MODE = 10
    FIRMWARE = 14
    SERIAL = 15
    GEAR = 20
    POSITION_MAX = 21
    VELOCITY_MAX = 22
    TORQUE_MAX = 23
    MOTOR_POSITION = 80  # [rad at the output]
    OUTPUT_POSITION = 81  # of the encoder at the output [rad]


WORDS: Final = frozenset(
    {
        *(Register.MASTER_ID, Register.ID, Register.TIMEOUT, Register.MODE),
        *(Register.FIRMWARE, Register.SERIAL),
    }
)
"""Registers that hold a 32-bit integer; the others hold floats."""
TIMEOUT_S: Final = 50e-6
IMPEDANCE_MODE: Final = 1  # "MIT": torque = kp (p - q) + kd (v - q_dot) + t


class Status(IntEnum):
    """Status in the upper four bits of a feedback's first byte; -1 before the first feedback."""

    UNKNOWN = -1
    DISABLED = 0
    ENABLED = 1
    OVERVOLTAGE = 8
    UNDERVOLTAGE = 9
    OVERCURRENT = 10
    HOT_BRIDGE = 11
    HOT_COIL = 12
    MASTER_SILENT = 13
    OVERLOAD = 14


def setpoint(data: bytearray, position: int, velocity: int, gains: tuple[int, int]) -> None:
    """Pack a setpoint into the data of a command: 16 bits of position, 12 each of velocity,
    stiffness and damping; its torque is 0."""
    kp, kd = gains
    _SETPOINT.pack_into(
        data, 0, position, velocity >> 4, (velocity & 0xF) << 4 | kp >> 8, kp & 0xFF,
        kd >> 4, (kd & 0xF) << 4 | _NO_TORQUE >> 8, _NO_TORQUE & 0xFF,
    )  # fmt: skip


_NO_TORQUE: Final = 0x7FF


def setpoint_of(data: bytes | bytearray) -> tuple[int, int, int, int] | None:
    """Position, velocity, stiffness and damping of a setpoint, in counts; None for commands."""
    if len(data) < 8 or bytes(data[:7]) == _COMMAND:
        return None
    position, v, v_kp, kp, kd, kd_t, _ = _SETPOINT.unpack_from(data)
    return position, v << 4 | v_kp >> 4, (v_kp & 0xF) << 8 | kp, kd << 4 | kd_t >> 4


def refresh(motor: int) -> Frame:
    """Request for a feedback, without a command."""
    return REGISTERS, bytes((motor & 0xFF, motor >> 8, _REFRESH, 0, 0, 0, 0, 0))


def read(motor: int, register: int) -> Frame:
    """Request to read a register."""
    return REGISTERS, bytes((motor & 0xFF, motor >> 8, _READ, register, 0, 0, 0, 0))


def write(motor: int, register: int, value: float) -> Frame:
    """Request to write a register; the value is lost when the motor's power is off."""
    head = bytes((motor & 0xFF, motor >> 8, _WRITE, register))
    return REGISTERS, head + (_WORD.pack(int(value)) if register in WORDS else _FLOAT.pack(value))


def time_out_of(can_id: int, data: bytes | bytearray) -> tuple[int, int] | None:
    """Motor and timeout, in units of TIMEOUT_S, in a frame that sets it; None for other frames."""
    if can_id != REGISTERS or len(data) < 8 or (data[2], data[3]) != (_WRITE, Register.TIMEOUT):
        return None
    return data[0] | data[1] << 8, int(value_of(Register.TIMEOUT, data))


def register_of(motor: int, data: bytes | bytearray) -> int | None:
    """Register of an answer; None for a feedback, or for another motor's answer.

    A feedback begins with status and ID, then the position. That of an unpowered motor is ambiguous
    only within 0.02 rad of one position next to -MAX, where no joint may go.
    """
    if len(data) < 8 or data[2] not in (_READ, _WRITE):
        return None
    return data[3] if data[0] | data[1] << 8 == motor else None


def value_of(register: int, data: bytes | bytearray) -> float:
    """Value in the answer for a register; NaN for a float that was never written."""
    value: float = (_WORD if register in WORDS else _FLOAT).unpack_from(data, 4)[0]
    return value


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback in counts; 0 corresponds to -MAX."""

    status: int
    position: int
    velocity: int
    torque: int
    bridge_C: int  # temperature
    coil_C: int


def feedback_of(motor: int, data: bytes | bytearray) -> Feedback | None:
    """Feedback of a motor; None if it is another motor's, or shorter than eight bytes."""
    if len(data) < 8 or (data[0] ^ motor) & 0xF:
        return None
    head, position, fast, both, torque, bridge, coil = _FEEDBACK.unpack_from(data)
    return Feedback(
        status=head >> 4,
        position=position,
        velocity=fast << 4 | both >> 4,
        torque=(both & 0xF) << 8 | torque,
        bridge_C=bridge,
        coil_C=coil,
    )
