"""Registers of motors over the wire: for set-up, never in a tick."""

from dataclasses import dataclass

from common.errors import DriveError, SilentDriveError
from drivers.can.wire import Frame
from drivers.damiao.frames import ANSWERS, Register, read, register_of, value_of, write
from drivers.motors.asking import TRIES, Asking, same


@dataclass(frozen=True, slots=True)
class Registers(Asking):
    """Registers of the motors on one wire."""

    def read(self, motor: int, register: Register, timeout_s: float, name: str) -> float:
        """Value of a register; NaN for one that was never written. Raises SilentDriveError when
        three questions stay without an answer, BusError."""
        return self._asked(motor, register, read(motor, register), timeout_s, name)

    def write(
        self, motor: int, register: Register, value: float, timeout_s: float, name: str
    ) -> None:
        """Set a register until the motor's power is off, and read it back. Raises DriveError if it
        does not hold, SilentDriveError, BusError."""
        self._asked(motor, register, write(motor, register, value), timeout_s, name)
        held = self.read(motor, register, timeout_s, name)
        if not same(held, value):
            raise DriveError(
                f"{name}: register {register.value} ({register.name.lower()}) does not hold "
                f"{value:g}; it reads {held:g}"
            )

    def _asked(
        self, motor: int, register: Register, question: Frame, timeout_s: float, name: str
    ) -> float:
        def answer(can_id: int, data: bytes | bytearray) -> float | None:
            # Reading and writing have answers of their own.
            own = can_id == motor + ANSWERS and register_of(motor, data) == register
            return value_of(register, data) if own and data[2] == question[1][2] else None

        value = self.ask(question, answer, timeout_s)
        if value is None:
            raise SilentDriveError(
                f"{name} does not answer ({TRIES} tries of {1000 * timeout_s:.0f} ms for register "
                f"{register.value}): is it powered, is {motor} its id and {motor + ANSWERS} (id + "
                f"{ANSWERS}) its master id?"
            )
        return value
