"""Registers of a Damiao motor: numbers, types, factory values, and writable ranges."""

import struct
from dataclasses import dataclass

from simulator.damiao.frames import Ranges
from simulator.damiao.models import MODELS, DamiaoMake

KT, OVER_CURRENT, ACC, DEC, MAX_SPEED = 1, 3, 4, 5, 6
MASTER_ID, CAN_ID, TIMEOUT, MODE = 7, 8, 9, 10
KP_ASR, KI_ASR, KP_APR = 25, 26, 27
P_MOTOR, P_OUTPUT = 80, 81
MIT, POSITION, VELOCITY, HYBRID = 1, 2, 3, 4
"""Values of MODE."""

TINY, HUGE = 1e-45, 3.5e38  # range of positive 32-bit floats
_UINTS = frozenset({7, 8, 9, 10, 13, 14, 15, 16, 35, 36})


_WRITABLE: dict[int, tuple[float, float]] = {
    0: (10.000001, HUGE), KT: (0.0, HUGE), 2: (80.0, 199.99998), OVER_CURRENT: (TINY, 0.99999994),
    ACC: (TINY, HUGE), DEC: (-HUGE, -TINY), MAX_SPEED: (TINY, HUGE), MASTER_ID: (0, 0x7FF),
    CAN_ID: (0, 0x7FF), TIMEOUT: (0, HUGE), MODE: (MIT, HYBRID), 21: (TINY, HUGE), 22: (TINY, HUGE),
    23: (TINY, HUGE), 24: (100.0, 1e4), KP_ASR: (0.0, HUGE), KI_ASR: (0.0, HUGE),
    KP_APR: (0.0, HUGE), 28: (0.0, HUGE), 29: (10.0, 60.0), 30: (TINY, 1.0), 31: (1.0, 30.0),
    32: (TINY, 500.0), 33: (100.0, 1e4), 34: (TINY, 1e4), 35: (0, 11),
}  # fmt: skip
"""Lowest and highest accepted value of each writable register; NaN is refused."""


def _factory(make: DamiaoMake, can_id: int) -> dict[int, float]:
    m = MODELS[make.model]
    return {
        0: 15.0, KT: 0.0, 2: 100.0, OVER_CURRENT: 0.8, ACC: 2.0, DEC: -2.0, MAX_SPEED: 600.0,
        MASTER_ID: make.master_id, CAN_ID: can_id, TIMEOUT: 0, MODE: MIT, 11: 0.0,
        12: m.rotor_inertia, 13: 3, 14: 5017, 15: can_id, 16: m.pole_pairs, 17: m.resistance,
        18: m.inductance, 19: m.flux, 20: m.gear, 21: m.p_max, 22: m.v_max, 23: m.t_max,
        24: 1000.0, KP_ASR: m.speed_kp, KI_ASR: 0.002, KP_APR: 54.0, 28: 0.0, 29: 32.0, 30: 1.0,
        31: 4.0, 32: 40.0, 33: 2500.0, 34: 100.0, 35: 4, 36: 4, **dict.fromkeys(range(50, 55), 0.0),
        55: make.motor_sign, P_MOTOR: 0.0, P_OUTPUT: 0.0,
    }  # fmt: skip


@dataclass(slots=True)
class Registers:
    """Register values of one motor, by number."""

    values: dict[int, float]

    @classmethod
    def of(cls, make: DamiaoMake, can_id: int) -> "Registers":
        """Factory values, overridden by those that the owner saved."""
        return cls(_factory(make, can_id) | dict(make.registers))

    def number(self, register: int) -> int:
        """Value of an integer register."""
        return int(self.values[register])

    @property
    def ranges(self) -> Ranges:
        """Full scales of frames."""
        return Ranges(self.values[21], self.values[22], self.values[23])

    @property
    def torque_constant(self) -> float:
        """Torque constant at the output that the motor assumes [Nm/A]: KT, or if that is 0,
        gear * 1.5 * pole pairs * flux * efficiency."""
        v = self.values
        return v[KT] or v[20] * 1.5 * v[16] * v[19] * v[30]

    def raw(self, register: int) -> bytes:
        """Four bytes of a register; 0 for a missing one."""
        value = self.values.get(register, 0)
        if register in _UINTS:
            return int(value).to_bytes(4, "little")
        return struct.pack("<f", value)

    def write(self, register: int, raw: bytes) -> bytes:
        """Write four bytes if the value is allowed; returns the value held then, or 0 if the
        register is read-only."""
        if register not in _WRITABLE:
            return bytes(4)
        uint = register in _UINTS
        value = int.from_bytes(raw, "little") if uint else struct.unpack("<f", raw)[0]
        if register in (MASTER_ID, CAN_ID):
            value &= 0x7FF
        low, high = _WRITABLE[register]
        if low <= value <= high:
            self.values[register] = value
        return self.raw(register)
