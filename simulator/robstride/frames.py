"""Frames of RobStride motors in their proprietary protocol, as packed and unpacked by controllers.

An identifier has 29 bits: type in bits 28 to 24, data in 23 to 8, address in 7 to 0.
"""

import struct
from typing import NamedTuple

from simulator.motor import Command, to_float, to_uint

GET_ID, CONTROL, FEEDBACK, ENABLE, STOP, ZERO = 0, 1, 2, 3, 4, 6
READ, WRITE, FAULTS, SAVE = 17, 18, 21, 22
BROADCAST = 0xFE  # broadcast address of an answer to GET_ID
_FOUR = struct.Struct(">HHHH")


class Ranges(NamedTuple):
    """Full scales of frames, to either side: [rad], [rad/s], [Nm]; gains start from 0."""

    p_max: float
    v_max: float
    t_max: float
    kp_max: float
    kd_max: float


def identifier(kind: int, data: int, address: int) -> int:
    """Identifier of a frame."""
    return kind << 24 | data << 8 | address


def control(data2: int, data: bytes, ranges: Ranges) -> Command | None:
    """Impedance command, with the torque in the identifier; None for a frame that is too short."""
    if len(data) < 8:
        return None
    p, v, kp, kd = _FOUR.unpack(data[:8])
    return Command(
        to_float(p, -ranges.p_max, ranges.p_max, 16),
        to_float(v, -ranges.v_max, ranges.v_max, 16),
        to_float(kp, 0.0, ranges.kp_max, 16),
        to_float(kd, 0.0, ranges.kd_max, 16),
        to_float(data2, -ranges.t_max, ranges.t_max, 16),
    )


def feedback(measured: tuple[float, float, float], ranges: Ranges, degC: float) -> bytes:
    """Data of a feedback: position [rad], velocity [rad/s] and torque [Nm], and a temperature."""
    p, v, t = (to_uint(x, -most, most, 16) for x, most in zip(measured, ranges[:3], strict=True))
    return _FOUR.pack(p, v, t, round(10.0 * degC) & 0xFFFF)
