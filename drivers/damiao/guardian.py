"""Guardian of Damiao motors: holds an arm whose daemon fell silent, and lowers it where it may not
hold on. Pure: frames and times in, frames out.

The motors let go when setpoints cease. The guardian hears the daemon's setpoints on the bus, and
while there are none it repeats the last ones without their velocity. It never moves a motor but to
lower it: along its own load, slowly, when it gets hot or was held for long. A daemon that is heard
again has the motors at once. Its beat says on the bus that it is there, and what it does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from drivers.can.wire import Frame
from drivers.damiao.frames import (
    ANSWERS,
    Scales,
    Status,
    feedback_of,
    register_of,
    scaled,
    setpoint,
    setpoint_of,
    time_out_of,
)
from drivers.damiao.settings import DamiaoDrive

#: Identifier of its beat: motors mind the low byte alone, and none has this id.
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
    drive: DamiaoDrive
    scales: Scales
    data: bytearray = field(default_factory=lambda: bytearray(8))
    heard_s: float | None = None  # last setpoint of the daemon
    position: float = 0.0  # p of the setpoint [rad at the output]
    gains: tuple[int, int] = (0, 0)
    enabled: bool = False
    here: float = 0.0  # position of the motor [rad at the output]
    hot: bool = False
    alone: bool = False  # its time-out is off: it was left to hold

    def hear(self, data: bytes | bytearray) -> None:
        """Take an answer of the motor."""
        if register_of(self.drive.node, data) is not None:
            return
        if (answer := feedback_of(self.drive.node, data)) is None:
            return
        self.enabled = answer.status == Status.ENABLED
        self.here = (answer.position - 0x7FFF) * self.scales.position
        self.hot = max(answer.bridge_C, answer.coil_C) >= HOT_C

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

    def __init__(self, drives: Sequence[DamiaoDrive]) -> None:
        self._motors = [
            _Motor(drive, Scales.of(p.position_max, p.velocity_max, p.torque_max_Nm))
            for drive, p in ((drive, drive.profile) for drive in drives)
        ]
        self._by_command = {motor.drive.node: motor for motor in self._motors}
        self._by_answer = {motor.drive.node + ANSWERS: motor for motor in self._motors}
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
        if (motor := self._by_command.get(can_id)) is not None:
            if (found := setpoint_of(data)) is not None:
                motor.heard_s = now
                counts, _, *gains = found
                motor.position = (counts - 0xFFFF / 2) * motor.scales.position
                motor.gains = gains[0], gains[1]
        elif (motor := self._by_answer.get(can_id)) is not None:
            motor.hear(data)
        elif (of := time_out_of(can_id, data)) and (motor := self._by_command.get(of[0])):
            motor.alone = not of[1]

    def step(self, now: float) -> list[Frame]:
        """Frames that are due."""
        frames: list[Frame] = []
        before = self.doing
        orphans = [motor for motor in self._motors if self._orphaned(motor, now)]
        if not orphans:
            self.doing, self._held_since_s = Doing.WATCHES, None
        elif now - self._commanded_s >= self._every_s:
            passed_s, self._commanded_s = now - self._commanded_s, now
            if self._held_since_s is None:
                self._held_since_s, passed_s = now, 0.0
            self._command(orphans, now - self._held_since_s, min(passed_s, 2.0 * self._every_s))
            frames += [(motor.drive.node, motor.data) for motor in orphans]
        # Its activity is known before its setpoints are heard.
        if self.doing is not before or now - self._beaten_s >= BEAT_EVERY_S - ROUNDING_S:
            self._beaten_s = now
            frames.insert(0, (BEAT, bytes([self.doing])))
        return frames

    def _orphaned(self, motor: _Motor, now: float) -> bool:
        heard_s = motor.heard_s
        return motor.enabled and heard_s is not None and now - heard_s > self._after_s

    def _command(self, motors: Sequence[_Motor], held_s: float, passed_s: float) -> None:
        """Write the setpoints of these motors, held for `held_s`, the last time `passed_s` ago."""
        long = held_s > LOWERS_AFTER_S
        lowered = [
            motor.lower(passed_s)
            for motor in motors
            if self.lowers or motor.hot or (long and not motor.alone)
        ]
        self.doing = Doing.LOWERS if any(lowered) else Doing.HOLDS
        self.unloaded = bool(lowered) and not any(lowered)
        for motor in motors:
            profile = motor.drive.profile
            counts = scaled(motor.position, profile.position_max, 16)
            setpoint(motor.data, counts, scaled(0.0, profile.velocity_max, 12), motor.gains)
