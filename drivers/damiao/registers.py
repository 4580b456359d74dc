"""Registers of motors over the wire, one question at a time: for set-up, never in a tick.

Answers carry neither a number nor a time, so that the queue is emptied before each question.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from common.errors import BusError, DriveError, SilentDriveError
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import ANSWERS, Register, read, register_of, value_of, write

TRIES: Final = 3
#: A float that was set reads the same but for its 24 bits.
SAME: Final = 1e-6
#: Of a wait, between two calls of `meanwhile` [s].
SLICE_S: Final = 0.005
#: Frames that may be queued before a question; more is a flood.
_QUEUED: Final = 2000


@dataclass(frozen=True, slots=True)
class Registers:
    """Registers of the motors on one wire. `meanwhile` is called at least every SLICE_S."""

    wire: Wire
    meanwhile: Callable[[], None] = lambda: None
    clock: Callable[[], float] = time.monotonic

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
        for _ in range(TRIES):
            try:
                for _ in range(_QUEUED):
                    if self.wire.receive(0.0) is None:
                        break
                self.wire.send([question])
                deadline = self.clock() + timeout_s
                while (left := deadline - self.clock()) > 0.0:
                    self.meanwhile()
                    frame = self.wire.receive(min(left, SLICE_S))
                    if frame is None or frame[0] != motor + ANSWERS:
                        continue
                    data = frame[1]
                    # Reading and writing have answers of their own.
                    if register_of(motor, data) == register and data[2] == question[1][2]:
                        return value_of(register, data)
            except BUS_FAILURES as error:
                raise BusError(f"the bus fails: {error}") from error
        raise SilentDriveError(
            f"{name} does not answer ({TRIES} tries of {1000 * timeout_s:.0f} ms for register "
            f"{register.value}): is it powered, is {motor} its id and {motor + ANSWERS} (id + "
            f"{ANSWERS}) its master id?"
        )


def same(held: float, wanted: float) -> bool:
    """True if a register holds what it should."""
    return math.isclose(held, wanted, rel_tol=SAME, abs_tol=SAME)
