"""Ticks of recorded frames of Damiao motors: `drivers.makes.RecordedTicks`."""

from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from drivers.api import Samples
from drivers.damiao.frames import refresh, setpoint_of
from drivers.damiao.replies import Replies
from drivers.damiao.settings import DamiaoDrive


class DamiaoTicks:
    """Samples and setpoints of frames, one after the other; a tick begins with the first motor's
    request. Whether a motor was to stop is not on the bus: an enabled one counts as operating."""

    def __init__(self, drives: Sequence[DamiaoDrive], period_s: float) -> None:
        self._replies = Replies(drives, period_s)
        self.velocity: Vector = np.zeros(len(drives))
        """Target velocities that were sent last (n,) [rad/s]."""
        self._first = refresh(drives[0].node)
        self._scales = [
            drive.wiring.motor_sign * 2.0 * drive.profile.velocity_max / 0xFFF for drive in drives
        ]
        self._joint_of = {drive.node: i for i, drive in enumerate(drives)}
        self._running = [False] * len(drives)

    def begins(self, can_id: int, data: bytes, *, sent: bool) -> bool:
        """True for the frame that a tick begins with."""
        return sent and (can_id, data) == self._first

    def begin(self, now: float) -> None:
        """Begin a tick."""
        self._replies.begin_tick(now)

    def take(self, can_id: int, data: bytes, *, sent: bool) -> None:
        """Take another frame of it."""
        if not sent:
            joint = self._replies.joint_of(can_id)
            if joint is not None:
                self._replies.take(joint, data)
        elif (joint := self._joint_of.get(can_id)) is not None:
            found = setpoint_of(data)
            if found is None:
                self._replies.pending[joint] += 1
            else:
                self._replies.pending[joint] = 1
                self.velocity[joint] = self._scales[joint] * (found[1] - 0xFFF / 2.0)

    def finish(self) -> Samples:
        """End the tick."""
        return self._replies.samples(self._replies.awaited.finish(), self._running, ())
