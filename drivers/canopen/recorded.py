"""Reconstruction of ticks from recorded CANopen frames: `drivers.makes.RecordedTicks`."""

import struct
from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from drivers.api import Samples
from drivers.canopen.answers import Answers
from drivers.canopen.codec import link_side, receive_pdos
from drivers.canopen.ids import SYNC
from drivers.canopen.settings import CanopenDrive


class CanopenTicks:
    """Samples and setpoints decoded from consecutive frames; a tick begins with SYNC."""

    def __init__(self, drives: Sequence[CanopenDrive], period_s: float) -> None:
        self._answers = Answers(drives, lambda event: None, period_s)
        self.velocity: Vector = np.zeros(len(drives))
        """Most recently sent target velocities (n,) [rad/s]."""
        self._slots: dict[int, tuple[int, struct.Struct, int, float, float]] = {}
        for i, drive in enumerate(drives):
            gain, bias = link_side(drive, "target_velocity")
            for pdo in receive_pdos(drive):
                for place, part in enumerate(pdo.fields):
                    if part.entry == "target_velocity":
                        self._slots[pdo.cob_id] = (i, pdo.layout, place, gain, bias)

    def begins(self, can_id: int, data: bytes, *, sent: bool) -> bool:
        """True if this frame begins a tick."""
        return can_id == SYNC

    def begin(self, now: float) -> None:
        """Begin a tick."""
        self._answers.awaited.expect_all(now)

    def take(self, can_id: int, data: bytes, *, sent: bool) -> None:
        """Take a frame of the tick, including its first."""
        if not sent:
            self._answers.take(can_id, data)
        elif (slot := self._slots.get(can_id)) is not None:
            i, layout, place, gain, bias = slot
            if len(data) >= layout.size:
                self.velocity[i] = (layout.unpack_from(data)[place] - bias) / gain

    def finish(self) -> Samples:
        """End the tick and return its samples."""
        return self._answers.finish(())
