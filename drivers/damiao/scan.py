"""Scan of a bus for Damiao motors: reads registers of all possible IDs, without commands."""

import math
from dataclasses import dataclass
from typing import Final

from drivers.can.wire import Wire
from drivers.damiao.frames import Register, read, register_of, value_of
from drivers.damiao.settings import MODELS
from drivers.motors.queries import received_frames
from drivers.motors.scan import scanned

#: Answer timeout of one motor [s].
ANSWER_S: Final = 0.03
IDS: Final = range(1, 16)
_READ: Final = (
    Register.MASTER_ID, Register.GEAR, Register.POSITION_MAX, Register.VELOCITY_MAX,
    Register.TORQUE_MAX, Register.FIRMWARE, Register.SERIAL,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FoundMotor:
    """Motor that answered, and its registers; NaN for those that it did not answer."""

    motor: int
    values: dict[Register, float]
    twice: bool = False  # a request got more than one answer

    @property
    def models(self) -> list[str]:
        """Models with its gear ratio."""
        gear = self.values[Register.GEAR]
        return [name for name, about in MODELS.items() if about.gear == gear]


def scan_motors(wire: Wire) -> list[FoundMotor]:
    """Motors that answer. Raises BusError if a master commands motors, or the bus fails."""
    return scanned(wire, IDS, IDS.__contains__, _found)


def _found(wire: Wire, motor: int) -> FoundMotor | None:
    values, answers = {}, 0
    for register in _READ:
        values[register], count = _asked(wire, motor, register)
        answers = max(answers, count)
        if not answers:
            return None
    return FoundMotor(motor, values, answers > 1)


def _asked(wire: Wire, motor: int, register: Register) -> tuple[float, int]:
    """Value of a register and the number of answers, under any master ID."""
    value, count = math.nan, 0
    wire.send([read(motor, register)])
    for _, data in received_frames(wire, ANSWER_S):
        if register_of(motor, data) == register:
            value, count = value_of(register, data), count + 1
    return value, count
