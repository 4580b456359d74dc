"""Set-up of Damiao motors: `drivers.motors.arm.Setup`.

It writes and reads back a few volatile registers, lost when the motor's power is off: the mode, and
the time without setpoints after which the motor goes limp.
"""

import math
from collections.abc import Mapping

from common.errors import DriveError, SilentDriveError
from drivers.can.wire import Frame
from drivers.damiao.frames import (
    ANSWERS,
    IMPEDANCE_MODE,
    TIMEOUT_S,
    Register,
    read,
    register_of,
    value_of,
    write,
)
from drivers.damiao.settings import DamiaoDrive
from drivers.motors.arm import MotorIdentity
from drivers.motors.queries import TRIES, Queries, same
from drivers.motors.replies import FAR


class DamiaoSetup(Queries):
    """Set-up of the motors on one wire."""

    def identified(self, drive: DamiaoDrive) -> MotorIdentity:
        """Identity of a motor, whose full scales are as configured. Raises DriveError."""
        for register, (field, wanted) in _ranges(drive).items():
            held = self.read(drive, register)
            if not same(held, wanted):
                raise DriveError(
                    f"{drive}: {_named(register)} reads {held:g}; "
                    f"`{field}` of the configuration requires {wanted:g}"
                )
        serial = int(self.read(drive, Register.SERIAL))
        firmware = int(self.read(drive, Register.FIRMWARE))
        known = None if serial in (0, 0xFFFFFFFF) else serial
        return MotorIdentity(f"{drive.profile.model}, firmware {firmware}", known)

    def begin(self, drive: DamiaoDrive) -> Frame:
        """Set up a motor except for its timeout, and return the frame that sets it: sent after the
        first setpoint, so that a holding motor does not go limp, and read back when the arm is
        enabled. Raises DriveError."""
        wanted = _wanted(drive)
        behind = write(drive.node, Register.TIMEOUT, wanted.pop(Register.TIMEOUT))
        self._set_up(drive, wanted)
        return behind

    def set_up(self, drive: DamiaoDrive) -> None:
        """Write all required registers, and check that both encoders agree. Raises DriveError."""
        self._set_up(drive, _wanted(drive))

    def _set_up(self, drive: DamiaoDrive, wanted: Mapping[Register, float]) -> None:
        for register, value in wanted.items():
            self.write(drive, register, value)
        motor, output = (
            self.read(drive, register)
            for register in (Register.MOTOR_POSITION, Register.OUTPUT_POSITION)
        )
        apart = math.remainder(motor - output, math.tau)
        if not abs(apart) <= FAR:
            raise DriveError(
                f"{drive}: its motor is at {motor:.3f} rad and its output at {output:.3f} rad, "
                f"{abs(apart):.2f} rad apart; at most {FAR:g} rad is allowed: its zero may be "
                "lost, or its output has no encoder"
            )

    def deviation(self, drive: DamiaoDrive) -> str | None:
        """First register that has lost its value, as text; None if there is none. Raises
        SilentDriveError."""
        for register, wanted in _wanted(drive).items():
            held = self.read(drive, register)
            if not same(held, wanted):
                return f"{_named(register)} reads {held:g}, not {wanted:g}"
        return None

    def leave(self, drive: DamiaoDrive) -> None:
        """Disable a motor's timeout. Raises DriveError."""
        self.write(drive, Register.TIMEOUT, 0)

    def read(self, drive: DamiaoDrive, register: Register) -> float:
        """Value of a register; NaN for one that was never written. Raises SilentDriveError after
        three unanswered requests, BusError."""
        return self._asked(drive, register, read(drive.node, register))

    def write(self, drive: DamiaoDrive, register: Register, value: float) -> None:
        """Write a volatile register and read it back. Raises DriveError if it does not keep the
        value, SilentDriveError, BusError."""
        self._asked(drive, register, write(drive.node, register, value))
        if not same(held := self.read(drive, register), value):
            what = f"{_named(register)} does not keep {value:g}"
            raise DriveError(f"{drive}: {what}; it reads {held:g}")

    def _asked(self, drive: DamiaoDrive, register: Register, question: Frame) -> float:
        node, timeout_s = drive.node, drive.profile.answer_timeout_s

        def answer(can_id: int, data: bytes | bytearray) -> float | None:
            # Reads and writes have different answers.
            own = can_id == node + ANSWERS and register_of(node, data) == register
            return value_of(register, data) if own and data[2] == question[1][2] else None

        value = self.ask(question, answer, timeout_s)
        if value is None:
            raise SilentDriveError(
                f"{drive} does not answer ({TRIES} tries of {1000 * timeout_s:.0f} ms for register "
                f"{register.value}): is it powered, is {node} its ID and {node + ANSWERS} (ID + "
                f"{ANSWERS}) its master ID?"
            )
        return value


def _named(register: Register) -> str:
    return f"register {register.value} ({register.name.lower()})"


def _wanted(drive: DamiaoDrive) -> dict[Register, float]:
    """Registers to write, and their values."""
    return {
        Register.TIMEOUT: round(drive.profile.master_timeout_s / TIMEOUT_S),
        Register.MODE: IMPEDANCE_MODE,
    }


def _ranges(drive: DamiaoDrive) -> dict[Register, tuple[str, float]]:
    """Registers that must agree with the configuration: its field and value."""
    profile = drive.profile
    return {
        Register.POSITION_MAX: ("position_max", profile.position_max),
        Register.VELOCITY_MAX: ("velocity_max", profile.velocity_max),
        Register.TORQUE_MAX: ("torque_max_Nm", profile.torque_max_Nm),
        Register.GEAR: ("model", profile.figures.gear),
        Register.MASTER_ID: ("wiring.node", drive.node + ANSWERS),
    }
