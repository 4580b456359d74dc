"""Language of Damiao motors: `drivers.motors.language.Language`.

Each tick requests a feedback and the output encoder's position from each motor.
"""

from collections.abc import Sequence
from typing import Final

from drivers.can.wire import Frame
from drivers.damiao.frames import (
    ANSWERS,
    CLEAR_ERROR,
    DISABLE,
    ENABLE,
    REGISTERS,
    Register,
    feedback_of,
    read,
    refresh,
    register_of,
    setpoint,
    setpoint_of,
    time_out_of,
    value_of,
)
from drivers.damiao.frames import Status as Code
from drivers.damiao.settings import DamiaoDrive
from drivers.motors.language import UNREPORTED, Feedback, Language, Output, State, Status

_WORDS: Final = {
    Code.DISABLED: "disabled",
    Code.ENABLED: "enabled",
    Code.OVERVOLTAGE: "over-voltage",
    Code.UNDERVOLTAGE: "under-voltage",
    Code.OVERCURRENT: "over-current",
    Code.HOT_BRIDGE: "power stage over-temperature",
    Code.HOT_COIL: "winding over-temperature",
    Code.MASTER_SILENT: "setpoint timeout",
    Code.OVERLOAD: "overload",
}
_STATES: Final = {Code.DISABLED: State.OFF, Code.ENABLED: State.ON}
STATUSES: Final = {
    code.value: Status(
        _STATES.get(code, State.FAILED),
        words,
        f"status 0x{code:X}",
        powered=code is Code.ENABLED,
        supplied=code is not Code.UNDERVOLTAGE,
        missed_us=code is Code.MASTER_SILENT,
    )
    for code, words in _WORDS.items()
}
"""Statuses by code; any other code counts as unreported."""


class DamiaoLanguage(Language):
    """Language of the motors of one arm."""

    outputs = True
    bits = 16, 12, 12
    gain_bits = 12

    def setpoint_id(self, motor: int) -> int:
        """Identifier of a motor's setpoint."""
        return motor

    def requests_to(self, drive: DamiaoDrive) -> Sequence[Frame]:
        """Requests of a tick to one motor."""
        return refresh(drive.node), read(drive.node, Register.OUTPUT_POSITION)

    def is_setpoint(self, can_id: int, data: bytes | bytearray) -> bool:
        """True if a frame that commands a motor is a setpoint."""
        return setpoint_of(data) is not None

    def fields(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Position, velocity, stiffness and damping of a setpoint, in counts."""
        return setpoint_of(data) or ()

    def write_fields(self, data: bytearray, fields: tuple[int, ...]) -> None:
        """Pack these counts into the data of a setpoint."""
        position, velocity, kp, kd = fields
        setpoint(data, position, velocity, (kp, kd))

    def answering(self, can_id: int) -> int | None:
        """Joint whose motor answers under this identifier."""
        return self.joint_of.get(can_id - ANSWERS)

    def commanded(self, can_id: int) -> int | None:
        """Joint whose motor is commanded under this identifier."""
        return self.joint_of.get(can_id)

    def masters(self, can_id: int) -> bool:
        """True for an identifier under which only a master of these motors sends."""
        return can_id in self.joint_of or can_id == REGISTERS

    def answer_of(
        self, joint: int, can_id: int, data: bytes | bytearray
    ) -> Feedback | Output | None:
        """Decoded answer of a motor; None for a frame that it cannot have sent."""
        motor = self.motors[joint]
        register = register_of(motor, data)
        if register == Register.OUTPUT_POSITION:
            output = value_of(register, data)
            # None for NaN, too.
            return Output(output) if abs(output) <= self.profiles[joint].position_max else None
        if register is not None:
            return Output(None)
        found = feedback_of(motor, data)
        if found is None:
            return None
        status, hottest = STATUSES.get(found.status, UNREPORTED), max(found.bridge_C, found.coil_C)
        return Feedback(status, found.position, found.velocity, found.torque, hottest)

    def enabling(self, joint: int) -> Sequence[Frame]:
        """Frames that enable a motor, to be sent after its setpoint."""
        return ((self.motors[joint], ENABLE),)

    def disabling(self, joint: int) -> Frame:
        """Frame that disables a motor."""
        return self.motors[joint], DISABLE

    def clearing(self, joint: int) -> Frame:
        """Frame that clears a motor's fault."""
        return self.motors[joint], CLEAR_ERROR

    def time_out_of(self, can_id: int, data: bytes | bytearray) -> tuple[int, bool] | None:
        """Joint in a frame that sets a timeout, and whether the timeout is then enabled."""
        if (found := time_out_of(can_id, data)) is None or found[0] not in self.joint_of:
            return None
        return self.joint_of[found[0]], bool(found[1])
