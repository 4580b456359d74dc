"""Frames of Damiao motors: commands, feedback and registers, as bytes. Pure.

A motor answers each command frame with one feedback frame, at its master id. Numbers of 16 and 12
bits are scaled between -MAX and +MAX; floats are IEEE 754, little-endian. Figures: the maker's
manuals and samples; docs/drives.md has the sources.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.can.wire import Frame

REGISTERS: Final = 0x7FF
ANSWERS: Final = 0x10  # usual distance of the master id from the motor's

_COMMAND: Final = b"\xff" * 7
ENABLE: Final = _COMMAND + b"\xfc"
DISABLE: Final = _COMMAND + b"\xfd"
CLEAR_ERROR: Final = _COMMAND + b"\xfb"

_READ, _WRITE, _REFRESH = 0x33, 0x55, 0xCC
_FLOAT: Final = struct.Struct("<f")
_SETPOINT: Final = struct.Struct(">HBBBBBB")
#: What 12 bits of stiffness [Nm/rad] and of damping [Nm s/rad] reach, in every model.
STIFFEST, MOST_DAMPING = 500.0, 5.0
_WORD: Final = struct.Struct("<I")
#: Status and id, position, velocity and torque in 40 bits, two temperatures.
_FEEDBACK: Final = struct.Struct(">BHBBBBB")


class Register(IntEnum):
    """Registers that are used."""

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
"""Registers that hold a whole number of 32 bits; the others hold floats."""
TIMEOUT_S: Final = 50e-6
IMPEDANCE_MODE: Final = 1  # "MIT": torque = kp (p - q) + kd (v - q_dot) + t


class Status(IntEnum):
    """Status in a feedback's upper four bits; -1 before the first."""

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
    """Write a setpoint into the data of a command: position of 16 bits, velocity of 12, stiffness
    and damping of 12 each; its torque is 0."""
    kp, kd = gains
    _SETPOINT.pack_into(
        data, 0, position, velocity >> 4, (velocity & 0xF) << 4 | kp >> 8, kp & 0xFF,
        kd >> 4, (kd & 0xF) << 4 | _NO_TORQUE >> 8, _NO_TORQUE & 0xFF,
    )  # fmt: skip


_NO_TORQUE: Final = 0x7FF


def setpoint_of(data: bytes | bytearray) -> tuple[int, int, int, int] | None:
    """Position, velocity, stiffness and damping of a setpoint, in counts; None for a command."""
    if len(data) < 8 or bytes(data[:7]) == _COMMAND:
        return None
    position, v, v_kp, kp, kd, kd_t, _ = _SETPOINT.unpack_from(data)
    return position, v << 4 | v_kp >> 4, (v_kp & 0xF) << 8 | kp, kd << 4 | kd_t >> 4


def refresh(motor: int) -> Frame:
    """Request of a feedback, which commands nothing."""
    return REGISTERS, bytes((motor & 0xFF, motor >> 8, _REFRESH, 0, 0, 0, 0, 0))


def read(motor: int, register: int) -> Frame:
    """Request of a register."""
    return REGISTERS, bytes((motor & 0xFF, motor >> 8, _READ, register, 0, 0, 0, 0))


def write(motor: int, register: int, value: float) -> Frame:
    """Request to change a register, until the motor's power is off."""
    head = bytes((motor & 0xFF, motor >> 8, _WRITE, register))
    return REGISTERS, head + (_WORD.pack(int(value)) if register in WORDS else _FLOAT.pack(value))


def time_out_of(can_id: int, data: bytes | bytearray) -> tuple[int, int] | None:
    """Motor and time-out, in units of TIMEOUT_S, of a frame that sets it; None for any other."""
    if can_id != REGISTERS or len(data) < 8 or (data[2], data[3]) != (_WRITE, Register.TIMEOUT):
        return None
    return data[0] | data[1] << 8, int(value_of(Register.TIMEOUT, data))


def register_of(motor: int, data: bytes | bytearray) -> int | None:
    """Register that an answer is about; None for a feedback, or another motor's.

    A feedback begins with status and id, then a position: that of a motor without power looks like
    an answer within 0.02 rad of one place next to -MAX, where no joint may go.
    """
    if len(data) < 8 or data[2] not in (_READ, _WRITE):
        return None
    return data[3] if data[0] | data[1] << 8 == motor else None


def value_of(register: int, data: bytes | bytearray) -> float:
    """Value in an answer about a register; NaN for a float that was never written."""
    value: float = (_WORD if register in WORDS else _FLOAT).unpack_from(data, 4)[0]
    return value


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback in counts, from 0 at -MAX on."""

    status: int
    position: int
    velocity: int
    torque: int
    bridge_C: int  # temperature
    coil_C: int


def feedback_of(motor: int, data: bytes | bytearray) -> Feedback | None:
    """Feedback of a motor; None where it is another motor's, or shorter than eight bytes."""
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
