"""Reconstruction of ticks from recorded frames of motors: `drivers.makes.RecordedTicks`."""

import numpy as np

from common.arrays import Vector
from drivers.api import Samples
from drivers.motors.language import Language, MotorDrives
from drivers.motors.replies import Replies


class MotorTicks:
    """Samples and setpoints decoded from consecutive frames; a tick begins with the first motor's
    request. Stop commands are not visible on the bus: an enabled motor counts as operating."""

    def __init__(self, drives: MotorDrives, language: Language, period_s: float) -> None:
        self._replies, self._language = Replies(drives, language, period_s), language
        self.velocity: Vector = np.zeros(len(drives))
        """Most recently sent target velocities (n,) [rad/s]."""
        self._signs = [float(drive.wiring.motor_sign) for drive in drives]
        self._running = [False] * len(drives)

    def begins(self, can_id: int, data: bytes, *, sent: bool) -> bool:
        """True if this frame begins a tick."""
        return sent and self._language.begins((can_id, data))

    def begin(self, now: float) -> None:
        """Begin a tick."""
        self._replies.begin_tick(now)

    def take(self, can_id: int, data: bytes, *, sent: bool) -> None:
        """Take a frame of the tick, including its first."""
        if not sent:
            joint = self._language.answering(can_id)
            if joint is not None:
                self._replies.take(joint, can_id, data)
        elif (joint := self._language.commanded(can_id)) is not None:
            found = self._language.setpoint_of(joint, can_id, data)
            if found is None:
                self._replies.pending[joint] += 1
            else:
                self._replies.pending[joint] = int(not self._language.asks_by_setpoint)
                self.velocity[joint] = self._signs[joint] * found[1]

    def finish(self) -> Samples:
        """End the tick and return its samples."""
        return self._replies.samples(self._replies.awaited.finish(), self._running, ())
