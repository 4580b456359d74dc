"""Set-up of Damiao motors: `drivers.motors.arm.Setup`.

It is a few registers, written until the motor's power is off, and read back: its mode, and the time
without setpoints after which it lets go.
"""

import math
from collections.abc import Mapping

from common.errors import DriveError
from drivers.can.wire import Frame
from drivers.damiao.frames import ANSWERS, IMPEDANCE_MODE, TIMEOUT_S, Register, write
from drivers.damiao.registers import Registers
from drivers.damiao.settings import DamiaoDrive
from drivers.motors.arm import MotorIdentity
from drivers.motors.asking import same
from drivers.motors.replies import FAR


class DamiaoSetup(Registers):
    """Set-up of the motors on one wire."""

    def identified(self, drive: DamiaoDrive) -> MotorIdentity:
        """Identity of a motor whose ranges are as configured. Raises DriveError."""
        timeout_s = drive.profile.answer_timeout_s

        def value(register: Register) -> float:
            return self.read(drive.node, register, timeout_s, str(drive))

        for register, (field, wanted) in _ranges(drive).items():
            held = value(register)
            if not same(held, wanted):
                raise DriveError(
                    f"{drive}: register {register.value} ({register.name.lower()}) reads {held:g}; "
                    f"`{field}` of the configuration means {wanted:g}"
                )
        serial = int(value(Register.SERIAL))
        return MotorIdentity(
            f"{drive.profile.model}, firmware {int(value(Register.FIRMWARE))}",
            None if serial in (0, 0xFFFFFFFF) else serial,
        )

    def begin(self, drive: DamiaoDrive) -> Frame:
        """Set a motor up but for its time-out, before which it would let go; that is to follow its
        first setpoint, and is read back when the arm is enabled. Raises DriveError."""
        wanted = _wanted(drive)
        behind = write(drive.node, Register.TIMEOUT, wanted.pop(Register.TIMEOUT))
        self._set_up(drive, wanted)
        return behind

    def set_up(self, drive: DamiaoDrive) -> None:
        """Write what is wanted, and check that both encoders are in one unit. Raises DriveError."""
        self._set_up(drive, _wanted(drive))

    def _set_up(self, drive: DamiaoDrive, wanted: Mapping[Register, float]) -> None:
        timeout_s = drive.profile.answer_timeout_s
        for register, value in wanted.items():
            self.write(drive.node, register, value, timeout_s, str(drive))
        motor, output = (
            self.read(drive.node, register, timeout_s, str(drive))
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
        """First register that a motor does not hold any more, in words. Raises SilentDriveError."""
        timeout_s = drive.profile.answer_timeout_s
        for register, wanted in _wanted(drive).items():
            held = self.read(drive.node, register, timeout_s, str(drive))
            if not same(held, wanted):
                return (
                    f"register {register.value} ({register.name.lower()}) reads {held:g}, not "
                    f"{wanted:g}"
                )
        return None

    def leave(self, drive: DamiaoDrive) -> None:
        """Switch off a motor's watch on us. Raises DriveError."""
        timeout_s = drive.profile.answer_timeout_s
        self.write(drive.node, Register.TIMEOUT, 0, timeout_s, str(drive))


def _wanted(drive: DamiaoDrive) -> dict[Register, float]:
    """Registers that are set, and their values."""
    return {
        Register.TIMEOUT: round(drive.profile.patience_s / TIMEOUT_S),
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
