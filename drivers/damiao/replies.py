"""Replies of the motors in a tick: feedback and output encoder, and the samples made of them.

A motor answers in the order of its commands, so that feedback on last tick's setpoint comes before
that on this tick's request.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from common.arrays import Vector
from drivers.api import DriveCondition, DriveStatus, Event, Kind, Samples
from drivers.awaited import Awaited, Freshness, frozen
from drivers.counts import correct
from drivers.damiao.frames import (
    ANSWERS,
    Feedback,
    Register,
    Scales,
    Status,
    feedback_of,
    register_of,
    status_of,
    value_of,
)
from drivers.damiao.settings import FAR, TURN, DamiaoDrive
from drivers.drive import harmonics
from drivers.plausibility import Plausibility

_C = DriveCondition
CONDITION_OF: Final = {
    Status.UNKNOWN: _C.UNKNOWN,
    Status.DISABLED: _C.OFF,
    Status.ENABLED: _C.OPERATING,
}
"""Conditions of a motor that was not commanded to stop; in any other status it has failed."""
WORDS: Final = {
    Status.UNKNOWN: "unknown",
    Status.DISABLED: "disabled",
    Status.ENABLED: "enabled",
    Status.OVERVOLTAGE: "over-voltage",
    Status.UNDERVOLTAGE: "under-voltage",
    Status.OVERCURRENT: "over-current",
    Status.HOT_BRIDGE: "power stage too hot",
    Status.HOT_COIL: "winding too hot",
    Status.MASTER_SILENT: "it missed us",
    Status.OVERLOAD: "overload",
}
WORKING: Final = (Status.UNKNOWN, Status.DISABLED, Status.ENABLED)
"""Statuses of a motor without a fault."""
HELD: Final = "held"


def _statuses(status: Status, stopping: bool) -> DriveStatus:
    held = stopping and status is Status.ENABLED
    unknown = status is Status.UNKNOWN
    words = HELD if held else WORDS[status]
    return DriveStatus(
        condition=_C.STOPPED if held else CONDITION_OF.get(status, _C.FAILED),
        state=words,
        detail="no reported status" if unknown else f"{words} (status 0x{status:X})",
        supplied=None if unknown else status is not Status.UNDERVOLTAGE,
        following=status is Status.ENABLED and not stopping,
    )


_STATUSES: Final = {
    (status, stopping): _statuses(status, stopping)
    for status in Status
    for stopping in (False, True)
}


def news_of(before: Status, now: Status, *, let_go: bool) -> tuple[Kind | None, str]:
    """Kind of event that another status of a motor is, and its words; let_go: it has no power
    because we said so."""
    if now is before:
        return None, ""
    if now is Status.MASTER_SILENT:
        return Kind.UNHEARD, "it missed our setpoints, and let go"
    if now not in WORKING:
        return Kind.ERROR, f"{WORDS[now]} (status 0x{now:X})"
    if before is Status.ENABLED and now is Status.DISABLED and not let_go:
        return Kind.RESTARTED, "it let go by itself"
    return None, ""


class Replies:
    """Frames in, samples out: two answers of each motor are awaited."""

    def __init__(self, drives: Sequence[DamiaoDrive], period_s: float) -> None:
        n = len(drives)
        self.awaited = Awaited([0b11 << 2 * i for i in range(n)], period_s)
        self._motors = tuple(drive.node for drive in drives)
        self._joint_of = {motor + ANSWERS: i for i, motor in enumerate(self._motors)}
        scales = [
            Scales.of(p.position_max, p.velocity_max, p.torque_max_Nm)
            for p in (drive.profile for drive in drives)
        ]
        self._plausibility = Plausibility(
            [
                drive.profile.figures.speed * period_s / scale.position
                for drive, scale in zip(drives, scales, strict=True)
            ]
        )
        signs = np.array([float(drive.wiring.motor_sign) for drive in drives])
        constants = [drive.profile.Nm_per_A for drive in drives]
        # Motors truncate: half a count more is the middle of what a count may be, and 0 is exact.
        self._middle = np.array([[0x7FFF], [0x7FF], [0x7FF]])
        self._gain = signs * np.array(
            [
                [s.position for s in scales],
                [s.velocity for s in scales],
                [s.torque / k for s, k in zip(scales, constants, strict=True)],
            ]
        )
        self._link_sign = np.array([float(drive.wiring.link_sign) for drive in drives])
        self._signs = signs
        self._offset = np.array([drive.wiring.link_offset for drive in drives])
        self._harmonics = harmonics(drives)
        self._counts = np.full((3, n), np.nan)
        self._output = np.full(n, np.nan)
        self._furthest = [drive.profile.position_max for drive in drives]
        self.statuses = [Status.UNKNOWN] * n
        self.pending = [0] * n
        """Setpoints of each motor that its feedback still is to come of."""
        self.acknowledged = [0] * n
        """Setpoints that each motor has answered since it was last asked to stop."""
        self.witnessed: Vector = np.full(n, np.nan)
        """Position of each motor [rad at the link]; NaN where its output does not agree."""
        self.late_frames = 0

    def begin_tick(self, now: float) -> None:
        """Await all: the question is about to go out."""
        self._plausibility.begin_tick()
        self.awaited.expect_all(now)

    def joint_of(self, can_id: int) -> int | None:
        """Joint whose motor answers at this identifier."""
        return self._joint_of.get(can_id)

    def take(self, joint: int, data: bytes | bytearray) -> bool:
        """Keep a motor's frame; False for one that cannot be its own."""
        register = register_of(self._motors[joint], data)
        if register is None:
            found = feedback_of(self._motors[joint], data)
            if found is None or not self._plausibility.admits(joint, found.position):
                return False
            self._feedback(joint, found)
        elif register == Register.OUTPUT_POSITION:
            output = value_of(register, data)
            if not abs(output) <= self._furthest[joint]:  # so for NaN
                return False
            self._output[joint] = output
            self._arrived(2 << 2 * joint)
        return True

    def _feedback(self, joint: int, found: Feedback) -> None:
        self.statuses[joint] = status_of(found.status)
        if self.pending[joint]:
            self.pending[joint] -= 1
            self.acknowledged[joint] += 1
            return
        self._counts[:, joint] = found.position, found.velocity, found.torque
        self._arrived(1 << 2 * joint)

    def _arrived(self, bit: int) -> None:
        if not self.awaited.take(bit):
            self.late_frames += 1
            self.awaited.punctuality.unawaited(bit)

    def samples(
        self, found: Freshness, stopping: Sequence[bool], events: tuple[Event, ...]
    ) -> Samples:
        """Samples of what came so far; `stopping`: joints held by command."""
        position, velocity, current = self._gain * (self._counts - self._middle)
        # The output encoder repeats itself with each turn; the motor's position says which it is.
        apart = self._signs * position - self._output
        turns = np.round(apart / TURN)
        self.witnessed = np.where(np.abs(apart - turns * TURN) <= FAR, position, np.nan)
        link: Vector = self._link_sign * (self._output + turns * TURN) + self._offset
        correct(link, self._offset, self._harmonics)
        pairs = zip(self.statuses, stopping, strict=True)
        return Samples(
            current=frozen(current),
            link_position=frozen(link),
            motor_velocity=frozen(velocity),
            motor_position=frozen(position),
            fresh=found.fresh,
            age_s=found.age_s,
            starting=found.starting,
            drives=tuple([_STATUSES[pair] for pair in pairs]),
            events=events,
        )
