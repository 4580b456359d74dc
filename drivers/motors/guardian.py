"""Guardian of motors that let go: holds an arm whose daemon fell silent, and lowers it where it may
not hold on. Pure: frames and times in, frames out.

The motors let go when setpoints cease. The guardian hears the daemon's setpoints on the bus, and
while there are none it repeats the last ones without their velocity. It never moves a motor but to
lower it: along its own load, slowly, when it gets hot or was held for long. A daemon that is heard
again has the motors at once. Its beat says on the bus that it is there, and what it does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from drivers.can.wire import Frame
from drivers.drive import Drive
from drivers.motors.language import Feedback, Language, MotorDrives, State

#: Identifier of its beat: motors of 11 bits mind the low byte alone, and none has this id; those
#: of 29 bits mind no other frame.
BEAT: Final = 0x7F0
BEAT_EVERY_S: Final = 0.02
#: Without its beat for so long it counts as gone.
GONE_S: Final = 0.1
ROUNDING_S: Final = 1e-6
#: It takes over after this share of the time that a motor waits; then it commands so often in it.
TAKES_OVER_SHARE: Final = 0.4
EVERY_SHARE: Final = 0.1
#: Held for so long [s], or from this temperature on [degC], a motor is lowered with this speed
#: [rad/s], until it bears less than this share of the torque that it may give.
LOWERS_AFTER_S: Final = 600.0
HOT_C: Final = 85
LOWERS: Final = 0.1
UNLOADED_SHARE: Final = 0.02


class Doing(IntEnum):
    """Activity of a guardian, as its beat says."""

    WATCHES = 0
    HOLDS = 1
    LOWERS = 2


@dataclass(slots=True)
class _Motor:
    drive: Drive[Any]
    step: float  # value of a count of its position [rad]
    data: bytes = b""  # of the last setpoint, the daemon's or our own
    heard_s: float | None = None  # last setpoint of the daemon
    position: float = 0.0  # p of the setpoint [rad at the output]
    enabled: bool = False
    here: float = 0.0  # position of the motor [rad at the output]
    hot: bool = False
    alone: bool = False  # its time-out is off: it was left to hold

    def hear(self, answer: Feedback, middle: float) -> None:
        """Take a feedback of the motor."""
        self.enabled = answer.status.state is State.ON
        self.here = (answer.position - middle) * self.step
        self.hot = answer.degC >= HOT_C

    def zero(self) -> None:
        """Keep the setpoint where it is, as the motor counts from now on: from where it stands."""
        self.position, self.here = self.position - self.here, 0.0

    def lower(self, passed_s: float) -> bool:
        """Move the setpoint along the load; False where the motor bears nothing to speak of."""
        profile = self.drive.profile
        borne = profile.stiffness * (self.position - self.here)
        most = profile.Nm_per_A * self.drive.wiring.max_current_A
        if abs(borne) <= UNLOADED_SHARE * most:
            return False
        self.position -= math.copysign(LOWERS * passed_s, borne)
        return True


class Guardian:
    """Guardian of the motors of one arm."""

    def __init__(self, drives: MotorDrives, language: Language) -> None:
        self._language = language
        self._motors = [
            _Motor(drive, steps[0]) for drive, steps in zip(drives, language.steps, strict=True)
        ]
        patience_s = min(drive.profile.patience_s for drive in drives)
        self._after_s, self._every_s = TAKES_OVER_SHARE * patience_s, EVERY_SHARE * patience_s
        self._held_since_s: float | None = None
        self._commanded_s = self._beaten_s = float("-inf")
        self.doing = Doing.WATCHES
        self.lowers = False
        """True where it is to lower the arm, however cool and short held."""
        self.unloaded = False
        """True where the motors that it lowers bear nothing any more."""

    def take(self, now: float, can_id: int, data: bytes | bytearray) -> None:
        """Take a frame of the bus."""
        language = self._language
        if (joint := language.commanded(can_id)) is not None:
            if (found := language.setpoint_of(joint, can_id, data)) is not None:
                motor = self._motors[joint]
                motor.heard_s, motor.position, motor.data = now, found[0], bytes(data)
        elif (joint := language.answering(can_id)) is not None:
            answer = language.answer_of(joint, can_id, data)
            if isinstance(answer, Feedback):
                self._motors[joint].hear(answer, language.middle[0])
        elif (of := language.time_out_of(can_id, data)) is not None:
            self._motors[of[0]].alone = not of[1]
        if (joint := language.zeroed(can_id)) is not None:
            self._motors[joint].zero()

    def step(self, now: float) -> list[Frame]:
        """Frames that are due."""
        frames: list[Frame] = []
        before = self.doing
        orphans = [i for i, motor in enumerate(self._motors) if self._orphaned(motor, now)]
        if not orphans:
            self.doing, self._held_since_s = Doing.WATCHES, None
        elif now - self._commanded_s >= self._every_s:
            passed_s, self._commanded_s = now - self._commanded_s, now
            if self._held_since_s is None:
                self._held_since_s, passed_s = now, 0.0
            self._command(orphans, now - self._held_since_s, min(passed_s, 2.0 * self._every_s))
            frames += [(self._language.setpoints[i][0], self._motors[i].data) for i in orphans]
        # Its activity is known before its setpoints are heard.
        if self.doing is not before or now - self._beaten_s >= BEAT_EVERY_S - ROUNDING_S:
            self._beaten_s = now
            frames.insert(0, (BEAT, bytes([self.doing])))
        return frames

    def _orphaned(self, motor: _Motor, now: float) -> bool:
        heard_s = motor.heard_s
        return motor.enabled and heard_s is not None and now - heard_s > self._after_s

    def _command(self, joints: Sequence[int], held_s: float, passed_s: float) -> None:
        """Write the setpoints of these joints, held for `held_s`, the last time `passed_s` ago."""
        long = held_s > LOWERS_AFTER_S
        lowered = [
            motor.lower(passed_s)
            for motor in (self._motors[i] for i in joints)
            if self.lowers or motor.hot or (long and not motor.alone)
        ]
        self.doing = Doing.LOWERS if any(lowered) else Doing.HOLDS
        self.unloaded = bool(lowered) and not any(lowered)
        for i in joints:
            motor = self._motors[i]
            motor.data = self._language.restated(i, motor.data, motor.position)
