"""Replies of the motors in a tick: feedback and output encoders, and the samples built from them.

A motor answers in the order of its commands, so the feedback to the last tick's setpoint precedes
that to this tick's request. Where the setpoint is the request, one feedback serves as both.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from common.arrays import Vector
from drivers.api import DriveCondition, DriveStatus, Event, Kind, Samples
from drivers.awaited import Awaited, Freshness, frozen
from drivers.counts import correct
from drivers.drive import harmonics
from drivers.motors.language import UNREPORTED, Feedback, Language, MotorDrives, State, Status
from drivers.plausibility import Plausibility

HELD: Final = "held"
#: Tolerance between motor and output position, modulo whole turns [rad]: larger than the gap, but
#: far smaller than the effect of a wrong gear ratio.
FAR: Final = 0.35
#: Tolerance between a motor's position change and its integrated velocity [rad].
CHANGES: Final = 0.03
#: Range of the output encoder, which is single-turn [rad].
TURN: Final = 2.0 * math.pi
_C = DriveCondition
_CONDITIONS: Final = {State.UNKNOWN: _C.UNKNOWN, State.OFF: _C.OFF, State.ON: _C.OPERATING}


@lru_cache
def drive_status(status: Status, stopping: bool) -> DriveStatus:
    """Status of a motor for the daemon; stopping: it is commanded to stop."""
    held = stopping and status.state is State.ON
    words = HELD if held else status.words
    failed = _C.FAILING if status.powered else _C.FAILED
    return DriveStatus(
        condition=_C.STOPPED if held else _CONDITIONS.get(status.state, failed),
        state=words,
        detail=f"{words} ({status.code})" if status.code else "no reported status",
        supplied=status.supplied,
        following=status.state is State.ON and not stopping,
    )


def news_of(before: Status, now: Status, *, released: bool) -> tuple[Kind | None, str]:
    """Kind and text of the event for a changed status of a motor; released: it has no power by our
    command."""
    if now == before:
        return None, ""
    if now.missed_us:
        return Kind.UNHEARD, "it missed our setpoints and went limp"
    if now.state is State.FAILED:
        return Kind.ERROR, f"{now.words} ({now.code})"
    if before.state is State.ON and now.state is State.OFF and not released:
        return Kind.RESTARTED, "it went limp without a command"
    return None, ""


class Replies:
    """Receiver of the motors' answers that produces the samples of each tick."""

    def __init__(self, drives: MotorDrives, language: Language, period_s: float) -> None:
        n = len(drives)
        self._language = language
        answers = 2 if language.outputs else 1  # of each motor
        self._bits = [1 << answers * i for i in range(n)]
        self.awaited = Awaited([(1 << answers) - 1 << answers * i for i in range(n)], period_s)
        # A motor's position is checked against the output encoder, or else its own velocity.
        per_count = [position for position, _, _ in language.steps]
        self.plausibility = Plausibility(
            [
                (drive.profile.figures.speed * period_s if language.outputs else CHANGES) / step
                for drive, step in zip(drives, per_count, strict=True)
            ]
        )
        self._speeds = [velocity * period_s / position for position, velocity, _ in language.steps]
        signs = np.array([float(drive.wiring.motor_sign) for drive in drives])
        # Motors truncate: half a count is added to centre the interval of a count; 0 is exact.
        self._middle = np.array([language.middle]).T
        torque = [1.0 / drive.profile.Nm_per_A for drive in drives]
        self._gain = signs * np.array(language.steps).T * np.array([[1.0] * n, [1.0] * n, torque])
        self._link_sign = np.array([float(drive.wiring.link_sign) for drive in drives])
        self._signs = signs
        self._offset = np.array([drive.wiring.link_offset for drive in drives])
        self._harmonics = harmonics(drives)
        self._counts = np.full((3, n), np.nan)
        self._output = np.full(n, np.nan)
        self.statuses = [UNREPORTED] * n
        self.pending = [0] * n
        """Number of commands of each motor whose feedback is still to come."""
        self.acknowledged = [0] * n
        """Number of commands that each motor has answered since its target last changed."""
        self.by_setpoint = [False] * n
        """True for motors whose setpoint was the request of this tick."""
        self.witnessed: Vector = np.full(n, np.nan)
        """Position of each motor [rad at the link]; NaN if it contradicts the output encoder, or,
        without such an encoder, if it jumped."""
        self.late_frames = 0

    def begin_tick(self, now: float, asked_s: float | None = None) -> None:
        """Await all answers: the requests are about to be sent, as `Awaited.expect_all`."""
        self.plausibility.begin_tick()
        self.awaited.expect_all(now, asked_s)

    def forget(self, joint: int) -> None:
        """Discard the position of this joint: its zero has changed."""
        self._counts[:, joint] = np.nan
        self.plausibility.forget([joint])

    def take(self, joint: int, can_id: int, data: bytes | bytearray) -> bool:
        """Take a motor's frame; False for one that it cannot have sent."""
        found = self._language.answer_of(joint, can_id, data)
        if found is None:
            return False
        if isinstance(found, Feedback):
            speed = (found.velocity - self._language.middle[1]) * self._speeds[joint]
            witness = None if self._language.outputs else speed
            if not self.plausibility.admits(joint, found.position, witness):
                return False
            self._feedback(joint, found)
        elif found.position is not None:
            self._output[joint] = found.position
            self._arrived(self._bits[joint] << 1)
        return True

    def _feedback(self, joint: int, found: Feedback) -> None:
        self.statuses[joint] = found.status
        if self.pending[joint]:
            self.pending[joint] -= 1
            self.acknowledged[joint] += 1
            return
        self.acknowledged[joint] += self.by_setpoint[joint]
        self._counts[:, joint] = found.position, found.velocity, found.torque
        self._arrived(self._bits[joint])

    def _arrived(self, bit: int) -> None:
        if not self.awaited.take(bit):
            self.late_frames += 1
            self.awaited.punctuality.unawaited(bit)

    def samples(
        self, found: Freshness, stopping: Sequence[bool], events: tuple[Event, ...]
    ) -> Samples:
        """Samples from the answers received so far; `stopping`: joints held by command."""
        position, velocity, current = self._gain * (self._counts - self._middle)
        link: Vector
        if self._language.outputs:
            # The output encoder is single-turn; the motor position resolves the turn.
            apart = self._signs * position - self._output
            turns = np.round(apart / TURN)
            self.witnessed = np.where(np.abs(apart - turns * TURN) <= FAR, position, np.nan)
            link = self._link_sign * (self._output + turns * TURN) + self._offset
        else:
            self.witnessed = np.where(self.plausibility.jumped, np.nan, position)
            link = position + self._offset
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
            drives=tuple([drive_status(*pair) for pair in pairs]),
            events=events,
        )
