"""Set-up of RobStride motors: `drivers.motors.arm.Setup`.

It is two parameters, written until the motor's power is off, and read back: its mode, and the
torque that it may give. The time-out, which not all models let be read, goes out with each tick.
"""

import math
from contextlib import suppress
from typing import Final

from common.errors import DriveError, SilentDriveError
from drivers.can.wire import Frame
from drivers.motors.arm import MotorIdentity
from drivers.motors.queries import TRIES, Answer, Queries, T, same
from drivers.robstride.frames import (
    IMPEDANCE_MODE,
    RUN,
    Feedback,
    Kind,
    Parameter,
    feedback_of,
    get_id,
    kind_of,
    mode_of,
    read,
    read_value,
    sender_of,
    uid_of,
    write,
)
from drivers.robstride.make import torque_limit
from drivers.robstride.settings import RobStrideDrive, serial_of

#: Position in a feedback and in its parameter may differ by rounding and slow motion [rad].
AGREE: Final = 0.003


class RobStrideSetup(Queries):
    """Set-up of the motors on one wire."""

    def identified(self, drive: RobStrideDrive) -> MotorIdentity:
        """Identity of a motor that can say its torque. Raises DriveError."""

        def uid(can_id: int, data: bytes | bytearray) -> int | None:
            own = kind_of(can_id) == Kind.GET_ID and sender_of(can_id) == drive.node
            return uid_of(data) if own and len(data) == 8 else None

        found = self._asked(drive, get_id(drive.node), uid)
        limit = self._read(drive, Parameter.TORQUE_LIMIT)
        if limit > drive.profile.torque_max_Nm and not same(limit, drive.profile.torque_max_Nm):
            raise DriveError(
                f"{drive}: it may give {limit:g} Nm (limit_torque), more than its feedback reaches "
                f"by `torque_max_Nm`, {drive.profile.torque_max_Nm:g}: which model is it?"
            )
        return MotorIdentity(drive.profile.model, serial_of(found))

    def begin(self, drive: RobStrideDrive) -> None:
        """Set a motor up that may be holding. Raises DriveError."""
        self.set_up(drive)

    def set_up(self, drive: RobStrideDrive) -> None:
        """Write what is wanted, and compare two reports of the position. Raises DriveError."""
        found = self._write(drive, Parameter.TORQUE_LIMIT, torque_limit(drive))
        if self._read(drive, Parameter.MODE) != IMPEDANCE_MODE:
            if mode_of(found.code) == RUN:
                raise DriveError(f"{drive}: it runs in another mode: switch its power off first")
            self._write(drive, Parameter.MODE, IMPEDANCE_MODE)
        step = 2.0 * drive.profile.position_max / 0xFFFF
        fed_back = (found.position - 0x7FFF) * step
        position = self._read(drive, Parameter.POSITION)
        if not abs(position) <= math.pi:
            raise DriveError(
                f"{drive}: it is at {position:.2f} rad; at most half a turn from 0 is allowed: set "
                "its zero, and zero_sta to 1 (docs/drives.md), then switch its power off and on"
            )
        if not abs(position - fed_back) <= AGREE:
            raise DriveError(
                f"{drive}: its feedback says {fed_back:.3f} rad by `position_max`, "
                f"{drive.profile.position_max:g}, and its mechPos {position:.3f} rad"
            )

    def deviation(self, drive: RobStrideDrive) -> str | None:
        """First parameter that a motor does not hold any more, in words. Raises
        SilentDriveError."""
        wanted = {Parameter.MODE: IMPEDANCE_MODE, Parameter.TORQUE_LIMIT: torque_limit(drive)}
        for parameter, value in wanted.items():
            held = self._read(drive, parameter)
            if not same(held, value):
                return f"{parameter.name.lower()} (0x{parameter:04X}) reads {held:g}, not {value:g}"
        return None

    def leave(self, drive: RobStrideDrive) -> None:
        """Switch off a motor's watch on us, and read it back where its model allows that. Raises
        DriveError.

        A model that does not reads 0, or has no answer: it gets three, as a feedback may answer
        another frame, and one may be lost.
        """
        for _ in range(TRIES):
            self._order(drive, write(drive.node, Parameter.TIMEOUT, 0))
        with suppress(SilentDriveError):
            if held := self._read(drive, Parameter.TIMEOUT):
                raise DriveError(
                    f"{drive}: its time-out (0x7028) does not hold 0; it reads {held:g}: without "
                    f"frames it lets go"
                )

    def _write(self, drive: RobStrideDrive, parameter: Parameter, value: float) -> Feedback:
        found = self._order(drive, write(drive.node, parameter, value))
        if not same(held := self._read(drive, parameter), value):
            what = f"{parameter.name.lower()} (0x{parameter:04X})"
            raise DriveError(f"{drive}: {what} does not hold {value:g}; it reads {held:g}")
        return found

    def _read(self, drive: RobStrideDrive, parameter: Parameter) -> float:
        def value(can_id: int, data: bytes | bytearray) -> float | None:
            own = kind_of(can_id) == Kind.READ and sender_of(can_id) == drive.node
            return read_value(parameter, can_id, data) if own else None

        return self._asked(drive, read(drive.node, parameter), value)

    def _order(self, drive: RobStrideDrive, order: Frame) -> Feedback:
        def feedback(can_id: int, data: bytes | bytearray) -> Feedback | None:
            own = kind_of(can_id) == Kind.FEEDBACK and sender_of(can_id) == drive.node
            return feedback_of(can_id, data) if own and len(data) == 8 else None

        return self._asked(drive, order, feedback)

    def _asked(self, drive: RobStrideDrive, question: Frame, answer: Answer[T]) -> T:
        timeout_s = drive.profile.answer_timeout_s
        found = self.ask(question, answer, timeout_s)
        if found is None:
            raise SilentDriveError(
                f"{drive} does not answer ({TRIES} tries of {1000 * timeout_s:.0f} ms): is it "
                f"powered, is {drive.node} its id, does it speak its maker's own protocol?"
            )
        return found
