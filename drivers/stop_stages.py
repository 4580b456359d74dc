"""Stop of one drive in stages: each has a deadline, and only what is seen ends it. Pure.

A drive that was told to stop stands when fresh readings say so: a statusword that has left
operation, and a velocity or a position that shows no motion. Until then it counts as running. The
stages get stronger, and none takes for granted what the one before needs:

    SETPOINT  quick stop in its RPDO, which acts at a SYNC
    SDO       quick stop written to 0x6040, which acts at once, also in pre-operational
    NMT       NMT stop, a loss of the connection at which a drive stops by itself (0x6007)
    SILENCE   no heartbeat, SYNC or setpoint any more, so that the drive's own watch acts (0x1016)

Time is an argument.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.cia402 import UNPOWERED, DriveState, PowerTarget
from drivers.drive import Drive

#: A drive needs two ticks to take a quick stop from its RPDO and to say so.
FEWEST_TICKS: Final = 3
#: Slower than this a motor stands [rad/s at the link]: a few counts of a coarse velocity...
STANDS: Final = 0.02
#: ...and this is how far one creeps at most in `STILL_S`; some velocities have a bias.
STILL_S: Final = 0.2
STILL_RAD: Final = STANDS * STILL_S
#: Readings in a row, so that noise proves nothing.
STILL_READINGS: Final = 2
#: A quick stop may take so much longer than its ramp: the load pulls, the loop lags...
RAMP_SHARE: Final = 0.5
#: ...and so long until it begins [s].
RAMP_LAG_S: Final = 0.02
#: A motor may swing so fast [rad/s]...
SWINGS: Final = 0.1
#: ...for so long after its ramp [s]: its link falls to and fro in the gap.
SWINGS_S: Final = 1.0
#: Ticks are quotients of times, travels products.
ROUNDING: Final = 0.01
#: A drive that was seen to obey needs to be seen again so many ticks later: slow ones take three to
#: answer one SDO, and samples are lost in bursts.
READING_TICKS: Final = 10
#: A motor that was knocked off its ramp slows down by this share from one reading to the next.
FALLING_SHARE: Final = 0.03
#: A motor that gives this share of its current limit against its motion does what it can.
RESISTING_SHARE: Final = 0.5
#: After so many readings in a row that say otherwise it runs on, and what was proved is void.
VOID_READINGS: Final = 20
#: A drive that is to be without power may wait so long for its brake [s].
BRAKE_S: Final = 1.0
#: States of a drive that does what a stop asks: without power, or stopping and holding by itself.
OBEYING: Final = UNPOWERED | {DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE}


class Stage(IntEnum):
    """Stages of a stop, in rising order of strength."""

    NONE = 0  # the drive may run
    SETPOINT = 1
    SDO = 2
    NMT = 3
    SILENCE = 4


@dataclass(frozen=True, slots=True)
class Seen:
    """Fresh reading of a drive that is to stop. SI at the link; NaN where it was not read."""

    state: DriveState
    velocity: float  # of the motor
    current: float = math.nan
    position: float = math.nan  # of the link


@dataclass(frozen=True, slots=True)
class Travel:
    """Travel of a joint from a fault on, at its velocity limit [rad at the link]."""

    noticing: float  # until the fault is found
    stages: float  # until the last stage begins
    patience: float  # until the drive misses us
    braking: float  # while it decelerates

    @property
    def total(self) -> float:
        """Travel between the fault and standstill, at worst [rad]."""
        return self.noticing + self.stages + self.patience + self.braking


def least_patience_s(drives: Sequence[Drive]) -> float:
    """How long the least patient drive waits for our heartbeat (0x1016) [s]."""
    return min(drive.profile.master_timeout_ms for drive in drives) / 1000.0


def stage_ticks(patience_s: float, period_s: float) -> int:
    """Ticks of the first stage; at full speed three times as many are left before silence. They
    take the drives' patience, if that leaves a drive the time to answer."""
    return max(FEWEST_TICKS, int(patience_s / period_s / 3.0 + 1e-9))


def worst_travel(drives: Sequence[Drive], period_s: float, noticing_ticks: int) -> list[Travel]:
    """Worst travel of each joint: full speed v until the fault is found, for the stages before
    silence, and for the drive's patience; then its quick stop, v^2 / (2 a)."""
    stages_s = 3 * stage_ticks(least_patience_s(drives), period_s) * period_s
    return [
        Travel(
            noticing=drive.velocity * noticing_ticks * period_s,
            stages=drive.velocity * stages_s,
            patience=drive.velocity * drive.profile.master_timeout_ms / 1000.0,
            braking=drive.velocity**2 / (2.0 * drive.quick_stop),
        )
        for drive in drives
    ]


@dataclass(frozen=True, slots=True)
class StopBounds:
    """How one drive stops, at the link, and how long and far that may take."""

    deceleration: float  # of its quick stop [rad/s2]
    current: float  # its limit [A]
    travel: float  # of its joint, from the first command on [rad]
    patience_s: float  # until it stops by itself when it misses our heartbeat
    ticks: int  # of each stage
    period_s: float


class StopWatch:
    """Watch on one drive: does it do what it was told, where it was told to stop?

    Stronger stages are for a drive that is in operation, or unheard. One that says it stops gets
    none for being moved: NMT stop and silence ask of it what it does already, and would cost the
    others their master. Once it runs on beyond its travel its power is to be `cut`, as where a
    monitored ramp is not kept (SS1-r of IEC 61800-5-2). It stands only when it is seen to.
    """

    stage: Stage
    proved: bool
    """It was seen to stand, and nothing against it since."""
    cut: bool
    """Its quick stop does not stop it within its travel: it is to be without power."""
    _wrong: float  # ticks without what was asked, less those with
    _now_s: float
    _from: float  # position at which it was told [rad]
    _gone: float  # travel since [rad]
    _speed: float  # last known [rad/s]
    _obeyed_s: float  # when it was last seen to
    _left_s: float  # when it was seen to have left operation...
    _left_speed: float  # ...and its speed then [rad/s]
    _still: int  # readings in a row that say so
    _moving: int  # readings in a row that say otherwise
    _beyond: int  # those of them that were taken beyond its travel
    _here: float  # where it has not moved from [rad]...
    _here_s: float  # ...since when

    def __init__(self, bounds: StopBounds) -> None:
        self._bounds = bounds
        self.begin(math.nan, Stage.NONE, math.nan, math.nan)

    @property
    def unproved(self) -> bool:
        """True while it is to stand and was not seen to."""
        return self.stage is not Stage.NONE and not self.proved

    @property
    def runs_on(self) -> bool:
        """True while it says that it stops, and moves as if it did not."""
        return self._moving >= VOID_READINGS

    def begin(self, now: float, stage: Stage, speed: float, position: float) -> None:
        """It is told to stop, in this stage, at `position` [rad] with `speed` [rad/s], the last
        that are known. What was proved before is void."""
        self.stage, self.proved, self.cut = stage, False, False
        self._wrong, self._now_s = 0.0, now
        self._from, self._gone = position, 0.0
        self._speed = 0.0 if math.isnan(speed) else abs(speed)
        self._left_s, self._obeyed_s = math.nan, -math.inf
        self._still = self._moving = self._beyond = 0
        self._here = math.nan

    def allow(self) -> None:
        """It may run."""
        self.stage, self.proved, self.cut = Stage.NONE, False, False

    def step(self, now: float, target: PowerTarget, seen: Seen | None) -> Stage | None:
        """Judge what was seen since the last tick (None: nothing fresh), after `begin`. Returns the
        stage that begins, None while none does."""
        dt, self._now_s = now - self._now_s, now
        if seen is not None:
            self._judge(now, seen)
        if self.proved or self.stage is Stage.SILENCE:
            return None
        if seen is not None and seen.state in OBEYING:
            self._wrong, self._obeyed_s = max(self._wrong - 1.0, 0.0), now
        elif seen is not None or not self._lately_obeyed(now):
            # However late a tick is, it is one chance that the drive was not given.
            self._wrong += min(dt / self._bounds.period_s, 2.0)
        self._follow(seen, dt)
        self.cut = self.cut or self._goes_further(seen)
        if self._wrong < self._patience_ticks(target) - ROUNDING and not self._runs_out():
            return None
        self.stage, self._wrong = Stage(self.stage + 1), 0.0
        return self.stage

    def _lately_obeyed(self, now: float) -> bool:
        return now - self._obeyed_s <= (READING_TICKS + ROUNDING) * self._bounds.period_s

    def _patience_ticks(self, target: PowerTarget) -> float:
        if target is PowerTarget.OFF and self.stage <= Stage.SDO:
            return BRAKE_S / self._bounds.period_s
        # To tell a drive by SDO and to read what it does takes an answer in each of three ticks.
        return self._bounds.ticks * self.stage

    # --- what a reading proves ---------------------------------------------------------------

    def _judge(self, now: float, seen: Seen) -> None:
        """Keep whether it is proved to stand."""
        if seen.state not in OBEYING:
            if self.proved:
                self.begin(now, Stage.SETPOINT, seen.velocity, seen.position)
            self._left_s, self._still, self._moving = math.nan, 0, 0
            return
        if math.isnan(self._left_s):
            self._left_s, self._left_speed = now, abs(seen.velocity)
        still = self._is_still(now, seen)
        self._still = self._still + 1 if still else 0
        # Without power it moves as the load or a hand will.
        calm = still or seen.state in UNPOWERED or self._stops(now, seen)
        self._moving = 0 if calm else self._moving + 1
        if self._still >= STILL_READINGS:
            self.proved, self._wrong = True, 0.0
        elif self.runs_on:
            self.proved = False

    def _is_still(self, now: float, seen: Seen) -> bool:
        if math.isnan(self._here) or not abs(seen.position - self._here) <= STILL_RAD:
            self._here, self._here_s = seen.position, now
        rests = not math.isnan(self._here) and now - self._here_s >= STILL_S
        return abs(seen.velocity) < STANDS or rests

    def _stops(self, now: float, seen: Seen) -> bool:
        """True if it slows down along the ramp, or at least does what it can: somebody may push
        harder than it brakes."""
        deceleration = RAMP_SHARE * self._bounds.deceleration
        ramp_s = now - self._left_s - RAMP_LAG_S
        bound = self._left_speed - deceleration * max(ramp_s, 0.0)
        swings = ramp_s < self._left_speed / deceleration + SWINGS_S
        speed, resists = abs(seen.velocity), -math.copysign(1.0, seen.velocity) * seen.current
        return (
            speed <= max(bound, SWINGS if swings else STANDS)
            or speed <= (1.0 - FALLING_SHARE) * self._speed
            or resists >= RESISTING_SHARE * self._bounds.current
        )

    # --- how far it goes ---------------------------------------------------------------------

    def _follow(self, seen: Seen | None, dt: float) -> None:
        """Keep how far it has gone: as measured; else at its last known speed, which sinks along
        the ramp where it was seen to obey."""
        if seen is not None and not math.isnan(seen.velocity):
            self._speed = abs(seen.velocity)
        elif self._lately_obeyed(self._now_s):
            self._speed = max(self._speed - RAMP_SHARE * self._bounds.deceleration * dt, 0.0)
        position = math.nan if seen is None else seen.position
        if math.isnan(position) or math.isnan(self._from):
            self._gone += self._speed * dt
        else:
            self._gone = abs(position - self._from)

    def _goes_further(self, seen: Seen | None) -> bool:
        """True if it runs on beyond its travel, for as many readings as a stage has ticks."""
        if seen is not None:
            beyond = self.runs_on and self._gone > self._bounds.travel
            self._beyond = self._beyond + 1 if beyond else 0
        return self._beyond >= self._bounds.ticks

    def _runs_out(self) -> bool:
        """True if the stages after this one could only just stop it within its travel."""
        if self.stage is Stage.SETPOINT or not self._wrong:
            return False
        bounds, v = self._bounds, self._speed
        left_s = bounds.patience_s
        if self.stage is Stage.SDO:
            left_s += bounds.ticks * bounds.period_s
        gone = self._gone + v * left_s + v * v / (2.0 * bounds.deceleration)
        return gone > bounds.travel * (1.0 - ROUNDING)
