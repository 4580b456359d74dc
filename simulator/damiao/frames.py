"""Values in the frames of Damiao motors, as packed and unpacked by their controllers."""

from struct import Struct
from typing import NamedTuple

from simulator.motor import Command, to_float, to_uint

KP_MAX, KD_MAX = 500.0, 5.0
_FLOAT, _FLOATS, _HYBRID = Struct("<f"), Struct("<ff"), Struct("<fHH")
_SHARES = 10_000  # full scale of both limits in a hybrid command


class Ranges(NamedTuple):
    """Full scales of frames: PMAX [rad], VMAX [rad/s] and TMAX [Nm]."""

    p_max: float
    v_max: float
    t_max: float


def impedance(data: bytes, ranges: Ranges) -> Command | None:
    """MIT command: position, velocity, kp, kd and torque in 16, 12, 12, 12 and 12 bits. None for a
    frame that is too short, here and below."""
    if len(data) < 8:
        return None
    packed = int.from_bytes(data[:8], "big")
    p_max, v_max, t_max = ranges
    return Command(
        to_float(packed >> 48, -p_max, p_max, 16),
        to_float(packed >> 36 & 0xFFF, -v_max, v_max, 12),
        to_float(packed >> 24 & 0xFFF, 0.0, KP_MAX, 12),
        to_float(packed >> 12 & 0xFFF, 0.0, KD_MAX, 12),
        to_float(packed & 0xFFF, -t_max, t_max, 12),
    )


def position_velocity(data: bytes, _: Ranges) -> Command | None:
    """Position command with a velocity limit, whose sign is ignored."""
    if len(data) < 8:
        return None
    position, velocity = _FLOATS.unpack_from(data)
    return Command(position, abs(velocity))


def velocity(data: bytes, _: Ranges) -> Command | None:
    """Velocity command; further bytes are ignored."""
    return Command(velocity=_FLOAT.unpack_from(data)[0]) if len(data) >= 4 else None


def hybrid(data: bytes, _: Ranges) -> Command | None:
    """Hybrid command: position, velocity limit [0.01 rad/s] and share of the current [0.0001]."""
    if len(data) < 8:
        return None
    position, fastest, share = _HYBRID.unpack_from(data)
    return Command(position, 0.01 * min(fastest, _SHARES), share=min(share, _SHARES) / _SHARES)


def feedback(
    can_id: int, status: int, measured: tuple[float, float, float], ranges: Ranges,
    degC: tuple[float, float],
) -> bytes:  # fmt: skip
    """Data of a feedback: position [rad], velocity [rad/s], torque [Nm] and two temperatures. An
    identifier of 16 or more overlaps the status."""
    p, v, t = (
        to_uint(x, -most, most, bits)
        for x, most, bits in zip(measured, ranges, (16, 12, 12), strict=True)
    )
    head = (can_id | status << 4) & 0xFF
    temperatures = (int(degree) & 0xFF for degree in degC)
    return bytes([head]) + (p << 24 | v << 12 | t).to_bytes(5, "big") + bytes(temperatures)
