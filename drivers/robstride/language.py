"""Language of RobStride motors: `drivers.motors.language.Language`.

Each tick sends each motor its setpoint, whose feedback is the sample. A motor without a setpoint
gets its timeout written again: the only frame that yields a feedback but commands nothing. Reading
a parameter yields a separate answer with one quantity.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from drivers.can.wire import Frame
from drivers.motors.language import Feedback, Language, Output, State, Status
from drivers.robstride.frames import (
    RUN,
    TIMEOUT_S,
    Fault,
    Kind,
    Parameter,
    clear,
    enable,
    faults_of,
    feedback_of,
    fields_of,
    kind_of,
    mode_of,
    sender_of,
    setpoint,
    setpoint_id,
    stop,
    write,
)
from drivers.robstride.settings import RobStrideDrive

_COMMANDS: Final = frozenset({Kind.SETPOINT, Kind.ENABLE, Kind.STOP})
#: All other frames change a motor: its zero, its ID, its stored parameters.
_HARMLESS: Final = frozenset({-1, Kind.GET_ID, Kind.FEEDBACK, Kind.READ, Kind.FAULTS})
_MODES: Final = {0: "reset", 1: "calibrating", RUN: "running"}
_WORDS: Final = {
    Fault.UNDERVOLTAGE: "under-voltage",
    Fault.OVERCURRENT: "over-current",
    Fault.OVERHEATED: "over-temperature",
    Fault.ENCODER: "encoder fault",
    Fault.OVERLOAD: "overload",
    Fault.UNCALIBRATED: "encoder not calibrated",
}


@lru_cache
def status_of(code: int) -> Status:
    """Status from the mode and faults of a feedback."""
    mode, faults = mode_of(code), faults_of(code)
    state = State.ON if mode == RUN else State.OFF
    return Status(
        State.FAILED if faults else state,
        ", ".join(_WORDS[fault] for fault in faults) or _MODES.get(mode, f"mode {mode}"),
        f"mode {mode}, faults 0x{faults:02X}",
        powered=mode == RUN,
        supplied=Fault.UNDERVOLTAGE not in faults,
    )


class RobStrideLanguage(Language):
    """Language of the motors of one arm."""

    outputs = False
    asks_by_setpoint = True
    bits = 16, 16, 16
    gain_bits = 16

    def setpoint_id(self, motor: int) -> int:
        """Identifier of a motor's setpoint."""
        return setpoint_id(motor)

    def requests_to(self, drive: RobStrideDrive) -> Sequence[Frame]:
        """Request to a motor without a setpoint."""
        timeout = round(drive.profile.master_timeout_s / TIMEOUT_S)
        return (write(drive.node, Parameter.TIMEOUT, timeout),)

    def is_setpoint(self, can_id: int, data: bytes | bytearray) -> bool:
        """True if a frame that commands a motor is a setpoint."""
        return kind_of(can_id) == Kind.SETPOINT and len(data) == 8

    def fields(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Position, velocity, stiffness and damping of a setpoint, in counts."""
        return fields_of(data)

    def write_fields(self, data: bytearray, fields: tuple[int, ...]) -> None:
        """Pack these counts into the data of a setpoint."""
        position, velocity, kp, kd = fields
        setpoint(data, position, velocity, (kp, kd))

    def answering(self, can_id: int) -> int | None:
        """Joint whose motor answers under this identifier."""
        return self.joint_of.get(sender_of(can_id)) if kind_of(can_id) == Kind.FEEDBACK else None

    def commanded(self, can_id: int) -> int | None:
        """Joint whose motor is commanded under this identifier."""
        return self.joint_of.get(can_id & 0xFF) if kind_of(can_id) in _COMMANDS else None

    def masters(self, can_id: int) -> bool:
        """True for an identifier under which only a master of these motors sends."""
        return kind_of(can_id) not in _HARMLESS and can_id & 0xFF in self.joint_of

    def zeroed(self, can_id: int) -> int | None:
        """Joint whose motor is given a new zero by this frame."""
        return self.joint_of.get(can_id & 0xFF) if kind_of(can_id) == Kind.ZERO else None

    def answer_of(
        self, joint: int, can_id: int, data: bytes | bytearray
    ) -> Feedback | Output | None:
        """Decoded answer of a motor; None for a frame that it cannot have sent."""
        if len(data) < 8:
            return None
        found = feedback_of(can_id, data)
        status = status_of(found.code)
        return Feedback(status, found.position, found.velocity, found.torque, found.degC)

    def enabling(self, joint: int) -> Sequence[Frame]:
        """Frame that enables a motor. Whether it keeps the previous setpoint is not published; it
        follows that of the next tick."""
        return (enable(self.motors[joint]),)

    def disabling(self, joint: int) -> Frame:
        """Frame that disables a motor."""
        return stop(self.motors[joint])

    def clearing(self, joint: int) -> Frame:
        """Frame that clears a motor's fault."""
        return clear(self.motors[joint])

    def time_out_of(self, can_id: int, data: bytes | bytearray) -> tuple[int, bool] | None:
        """Joint in a frame that sets a timeout, and whether the timeout is then enabled."""
        joint = self.joint_of.get(can_id & 0xFF)
        head = Parameter.TIMEOUT.to_bytes(4, "little")
        if joint is None or (can_id, data[:4]) != (self.requests[joint][0], head):
            return None
        return joint, any(data[4:8])
