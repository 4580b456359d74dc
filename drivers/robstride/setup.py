"""Set-up of RobStride motors: `drivers.motors.arm.Setup`.

It writes and reads back two volatile parameters, lost when the motor's power is off: the mode and
the torque limit. The timeout, which is write-only in some models, is sent with each tick.
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

#: Tolerance between the position in a feedback and its parameter: rounding and slow motion [rad].
AGREE: Final = 0.003


class RobStrideSetup(Queries):
    """Set-up of the motors on one wire."""

    def identified(self, drive: RobStrideDrive) -> MotorIdentity:
        """Identity of a motor whose feedback covers its torque limit. Raises DriveError."""

        def uid(can_id: int, data: bytes | bytearray) -> int | None:
            own = kind_of(can_id) == Kind.GET_ID and sender_of(can_id) == drive.node
            return uid_of(data) if own and len(data) == 8 else None

        found = self._asked(drive, get_id(drive.node), uid)
        limit = self._read(drive, Parameter.TORQUE_LIMIT)
        if limit > drive.profile.torque_max_Nm and not same(limit, drive.profile.torque_max_Nm):
            raise DriveError(
                f"{drive}: its torque limit of {limit:g} Nm (limit_torque) exceeds that of its "
                f"feedback, `torque_max_Nm` {drive.profile.torque_max_Nm:g}: is it another model?"
            )
        return MotorIdentity(drive.profile.model, serial_of(found))

    def begin(self, drive: RobStrideDrive) -> None:
        """Set up a motor that may be holding. Raises DriveError."""
        self.set_up(drive)

    def set_up(self, drive: RobStrideDrive) -> None:
        """Write all required parameters, and compare the position in feedback and parameter. Raises
        DriveError."""
        found = self._write(drive, Parameter.TORQUE_LIMIT, torque_limit(drive))
        if self._read(drive, Parameter.MODE) != IMPEDANCE_MODE:
            if mode_of(found.code) == RUN:
                raise DriveError(f"{drive}: it runs in another mode: switch off its power first")
            self._write(drive, Parameter.MODE, IMPEDANCE_MODE)
        step = 2.0 * drive.profile.position_max / 0xFFFF
        fed_back = (found.position - 0x7FFF) * step
        position = self._read(drive, Parameter.POSITION)
        if not abs(position) <= math.pi:
            raise DriveError(
                f"{drive}: it is at {position:.2f} rad; at most half a turn from 0 is allowed: set "
                "its zero, and zero_sta to 1 (docs/drives.md), then power-cycle it"
            )
        if not abs(position - fed_back) <= AGREE:
            raise DriveError(
                f"{drive}: its feedback reads {fed_back:.3f} rad with `position_max` "
                f"{drive.profile.position_max:g}, but its mechPos {position:.3f} rad"
            )

    def deviation(self, drive: RobStrideDrive) -> str | None:
        """First parameter that has lost its value, as text; None if there is none. Raises
        SilentDriveError."""
        wanted = {Parameter.MODE: IMPEDANCE_MODE, Parameter.TORQUE_LIMIT: torque_limit(drive)}
        for parameter, value in wanted.items():
            held = self._read(drive, parameter)
            if not same(held, value):
                return f"{parameter.name.lower()} (0x{parameter:04X}) reads {held:g}, not {value:g}"
        return None

    def leave(self, drive: RobStrideDrive) -> None:
        """Disable a motor's timeout, and read it back if its model allows that. Raises DriveError.

        Other models read 0 or do not answer. The frame is sent three times: a feedback may answer
        another frame, and one may be lost."""
        for _ in range(TRIES):
            self._order(drive, write(drive.node, Parameter.TIMEOUT, 0))
        with suppress(SilentDriveError):
            if held := self._read(drive, Parameter.TIMEOUT):
                raise DriveError(
                    f"{drive}: its timeout (0x7028) does not keep 0; it reads {held:g}: without "
                    f"frames it goes limp"
                )

    def _write(self, drive: RobStrideDrive, parameter: Parameter, value: float) -> Feedback:
        found = self._order(drive, write(drive.node, parameter, value))
        if not same(held := self._read(drive, parameter), value):
            what = f"{parameter.name.lower()} (0x{parameter:04X})"
            raise DriveError(f"{drive}: {what} does not keep {value:g}; it reads {held:g}")
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
                f"powered, is {drive.node} its ID, does it use the RobStride protocol?"
            )
        return found
