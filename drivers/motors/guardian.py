"""Guardian of motors that go limp: holds an arm whose daemon fell silent, and lowers it if it must
not hold on. Pure: frames and times in, frames out.

The motors go limp when setpoints cease. The guardian monitors the daemon's setpoints on the bus,
and in their absence repeats the last ones with zero velocity. It moves a motor only to lower it,
slowly in the direction of its load, when it is hot or was held for long. A daemon that is heard
again gets the motors back at once. Its own heartbeat (beat) reports its presence and activity.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from drivers.can.wire import Frame
from drivers.drive import Drive
from drivers.motors.language import Feedback, Language, MotorDrives, State

#: Identifier of its beat: motors with 11-bit identifiers evaluate only the low byte, which is no
#: motor's ID; those with 29-bit identifiers ignore 11-bit frames.
BEAT: Final = 0x7F0
BEAT_EVERY_S: Final = 0.02
#: Time without a beat after which the guardian counts as gone.
GONE_S: Final = 0.1
ROUNDING_S: Final = 1e-6
#: Shares of the shortest motor timeout: until it takes over, and between its commands then.
TAKES_OVER_SHARE: Final = 0.4
EVERY_SHARE: Final = 0.1
#: After this time of holding [s], or from this temperature on [degC], a motor is lowered at this
#: speed [rad/s], until its load is below this share of its torque limit.
LOWERS_AFTER_S: Final = 600.0
HOT_C: Final = 85
LOWERS: Final = 0.1
UNLOADED_SHARE: Final = 0.02


class Activity(IntEnum):
    """Activity of a guardian, as reported in its beat."""

    WATCHES = 0
    HOLDS = 1
    LOWERS = 2


@dataclass(slots=True)
class _Motor:
    drive: Drive[Any]
    step: float  # value of one count of its position [rad]
    data: bytes = b""  # of the last setpoint, the daemon's or our own
    heard_s: float | None = None  # time of the daemon's last setpoint
    position: float = 0.0  # p of the setpoint [rad at the output]
    enabled: bool = False
    here: float = 0.0  # position of the motor [rad at the output]
    hot: bool = False
    alone: bool = False  # its timeout is disabled: it was left holding on purpose

    def on_feedback(self, answer: Feedback, middle: float) -> None:
        """Take a feedback of the motor."""
        self.enabled = answer.status.state is State.ON
        self.here = (answer.position - middle) * self.step
        self.hot = answer.degC >= HOT_C

    def zero(self) -> None:
        """Shift the setpoint to the motor's new zero, which is its present position."""
        self.position, self.here = self.position - self.here, 0.0

    def lower(self, passed_s: float) -> bool:
        """Move the setpoint in the direction of the load; False if the load is negligible."""
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
        timeout_s = min(drive.profile.master_timeout_s for drive in drives)
        self._after_s, self._every_s = TAKES_OVER_SHARE * timeout_s, EVERY_SHARE * timeout_s
        self._held_since_s: float | None = None
        self._commanded_s = self._beaten_s = float("-inf")
        self.activity = Activity.WATCHES
        self.lowers = False
        """Request to lower the arm regardless of temperature and time."""
        self.unloaded = False
        """True once the motors that it lowers carry no load any more."""

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
                self._motors[joint].on_feedback(answer, language.middle[0])
        elif (of := language.time_out_of(can_id, data)) is not None:
            self._motors[of[0]].alone = not of[1]
        if (joint := language.zeroed(can_id)) is not None:
            self._motors[joint].zero()

    def step(self, now: float) -> list[Frame]:
        """Frames that are due at `now`."""
        frames: list[Frame] = []
        before = self.activity
        orphans = [i for i, motor in enumerate(self._motors) if self._orphaned(motor, now)]
        if not orphans:
            self.activity, self._held_since_s = Activity.WATCHES, None
        elif now - self._commanded_s >= self._every_s:
            passed_s, self._commanded_s = now - self._commanded_s, now
            if self._held_since_s is None:
                self._held_since_s, passed_s = now, 0.0
            self._command(orphans, now - self._held_since_s, min(passed_s, 2.0 * self._every_s))
            frames += [(self._language.setpoints[i][0], self._motors[i].data) for i in orphans]
        # The beat goes first: the daemon must know the activity before it hears the setpoints.
        if self.activity is not before or now - self._beaten_s >= BEAT_EVERY_S - ROUNDING_S:
            self._beaten_s = now
            frames.insert(0, (BEAT, bytes([self.activity])))
        return frames

    def _orphaned(self, motor: _Motor, now: float) -> bool:
        heard_s = motor.heard_s
        return motor.enabled and heard_s is not None and now - heard_s > self._after_s

    def _command(self, joints: Sequence[int], held_s: float, passed_s: float) -> None:
        """Write the setpoints of these joints, held for `held_s`, last written `passed_s` ago."""
        long = held_s > LOWERS_AFTER_S
        lowered = [
            motor.lower(passed_s)
            for motor in (self._motors[i] for i in joints)
            if self.lowers or motor.hot or (long and not motor.alone)
        ]
        self.activity = Activity.LOWERS if any(lowered) else Activity.HOLDS
        self.unloaded = bool(lowered) and not any(lowered)
        for i in joints:
            motor = self._motors[i]
            motor.data = self._language.restated(i, motor.data, motor.position)
