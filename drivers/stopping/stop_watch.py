"""Stop of one drive in stages, each with a deadline; only an observed standstill ends it. Pure.

A drive that was commanded to stop counts as running until fresh readings confirm a standstill: its
status shows that it obeys, and all of its sensors agree (`witness`). Each stage is stronger than
the last and independent of it; the make of drive defines what it sends. Time is an argument.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.api import DriveCondition
from drivers.stopping.distance import Distance
from drivers.stopping.witness import MOVES, STANDS, Witness

#: Still readings that prove a standstill, and how many of them a moving one cancels (noise).
STILL_READINGS: Final = 2
STILL_LOST: Final = 4
#: Still readings needed after motion voided a proof; doubled each time, up to a maximum.
STILL_AGAIN: Final = 20
STILL_MOST: Final = 160
#: Lowest deceleration of a quick stop as a share of its ramp: the load pulls, the loop lags.
RAMP_SHARE: Final = 0.5
#: Longest time until the ramp begins [s].
RAMP_LAG_S: Final = 0.02
#: Speed at which a motor may oscillate after its ramp [rad/s].
SWINGS: Final = 0.1
#: Longest time for which it may oscillate [s]: its link falls back and forth in the gap.
SWINGS_S: Final = 1.0
#: Relative tolerance: ticks are quotients of times, and travels are products.
ROUNDING: Final = 0.01
#: Time for which an observed obedience holds [ticks]: slow drives take three to answer one SDO, and
#: samples are lost in bursts.
READING_TICKS: Final = 10
#: A motor that was knocked off its ramp decelerates if its speed falls below its minimum by this.
FALLING_SHARE: Final = 0.03
#: A motor whose current opposes its motion with this share of its limit is resisting.
RESISTING_SHARE: Final = 0.5
#: Count of contrary readings from which a drive counts as running on, and its proof is void.
VOID_READINGS: Final = 20
#: Upper bound of such a count, and its decrement by any other reading: slips are short.
MOST_READINGS: Final = 25.0
CALM_SHARE: Final = 0.25
#: The proof of a powered drive is void after so long without a reading [s].
PROOF_S: Final = 0.3
#: A link has left its standstill position beyond LEEWAY (tolerance of the identified gap) times its
#: gap plus LEFT_RAD [rad].
LEFT_RAD: Final = 0.02
LEEWAY: Final = 1.5
#: Ramp and friction together decelerate a motor by at most this multiple of its ramp.
SUDDEN_SHARE: Final = 3.0
#: Conditions of a drive that obeys a stop command: unpowered, or stopping and holding by itself.
OBEYING: Final = frozenset(
    {
        *(condition for condition in DriveCondition if not condition.powered),
        *(DriveCondition.STOPPED, DriveCondition.FAILING),
    }
)


class Stage(IntEnum):
    """Stages of a stop, in increasing order of strength."""

    NONE = 0  # the drive may run
    SETPOINT = 1  # stop command in the cyclic setpoint frames
    DIRECT = 2  # stop command in a separate frame
    LAST = 3  # strongest available command
    SILENCE = 4  # no frames are sent, so that the drive's own master timeout acts


@dataclass(frozen=True, slots=True)
class StopReading:
    """Fresh reading of a drive that is to stop, in SI units at the link; NaN if not read."""

    condition: DriveCondition
    velocity: float  # of the motor
    current: float = math.nan
    position: float = math.nan  # of the link
    motor: float = math.nan  # position of the motor, if it has a sensor of its own
    asked: bool = False  # read individually, not as a cyclic sample


@dataclass(frozen=True, slots=True)
class StopBounds:
    """Bounds on the stop of one drive, at the link: deceleration, current, time and travel."""

    deceleration: float  # of its quick stop [rad/s2]
    current: float  # its limit [A]
    travel: float  # of its joint, from the first stop command on [rad]
    play: float  # between link and motor [rad]
    master_timeout_s: float  # after which it stops by itself
    ticks: int  # of each stage
    period_s: float
    falls: bool = False  # its joint falls without power: cutting it needs evidence of two sensors


class StopWatch:
    """Watch on one drive: checks that it obeys a stop command.

    Stronger stages apply to a drive that is in operation or unheard, not to one that is moved while
    it reports that it stops: it already does what they command, and silence would deprive the other
    drives of their master. If it runs on beyond its travel, its power is to be `cut`, as for a
    violated monitored ramp (SS1-r of IEC 61800-5-2).
    """

    stage: Stage
    proved: bool
    """A standstill was observed, and nothing has contradicted it since."""
    cut: bool
    """Its quick stop does not stop it within its travel: its power is to be cut."""
    moves: bool
    """Its last reading shows motion under power, whatever was proved."""
    _read_s: float  # time of the last reading
    _powered: bool  # at the last reading
    _disobeyed: float  # ticks without obedience minus those with
    _now_s: float
    _resisting: bool  # it brakes near its current limit, and does not slow down
    _obeyed_s: float  # time of the last observed obedience
    _left_s: float  # time at which it was observed to have left operation
    _left_speed: float  # its speed then [rad/s]
    _lowest_speed: float  # lowest speed since then [rad/s]
    _stood: float  # link position at the proved standstill [rad]
    _stood_s: float
    _still: int  # count of still readings, less STILL_LOST for each moving one
    _needed: int  # value of `_still` for a proof
    _moving: float  # count of readings that show it running on
    _beyond: float  # count of readings beyond its travel
    _asked: Witness  # of its individual readings since the stop command

    def __init__(self, bounds: StopBounds) -> None:
        self._bounds = bounds
        self._distance = Distance(bounds.travel, falls=bounds.falls)
        self.witness = Witness(SUDDEN_SHARE * bounds.deceleration)
        """Witness of its cyclic samples, maintained also while it runs."""
        self.begin(math.nan, Stage.NONE, math.nan)

    @property
    def unproved(self) -> bool:
        """True while a stop command is in force and no standstill is confirmed."""
        return self.stage is not Stage.NONE and not self.proved

    @property
    def speed(self) -> float:
        """Last known speed [rad/s]."""
        return self._distance.speed

    @property
    def runs_on(self) -> bool:
        """True while it reports that it is stopping, but moves as if it were not."""
        return self._moving >= VOID_READINGS

    def begin(self, now: float, stage: Stage, speed: float) -> None:
        """Begin a stop in this stage from the last known `speed` [rad/s] and the positions of the
        last samples. Any earlier proof is void."""
        self.stage, self.proved, self.cut, self.moves = stage, False, False, False
        self._disobeyed, self._now_s = 0.0, now
        self._read_s, self._powered = now, True
        self._distance.begin(self.witness.link.value, self.witness.motor.value, speed)
        self._resisting = False
        self._left_s, self._obeyed_s, self._lowest_speed = math.nan, -math.inf, math.inf
        self._stood = self._stood_s = math.nan
        self._still, self._moving, self._beyond = 0, 0.0, 0.0
        self._needed = STILL_READINGS
        # The history of individual readings continues that of the samples.
        self._asked = self.witness.copy()

    def allow(self) -> None:
        """Let it run: end the watch."""
        self.stage, self.proved, self.cut, self.moves = Stage.NONE, False, False, False

    def step(self, now: float, seen: StopReading | None) -> Stage | None:
        """Evaluate the reading since the last tick (None: nothing fresh), after `begin`. Returns
        the stage that begins in this tick, or None."""
        dt, self._now_s = now - self._now_s, now
        if seen is not None:
            self._read_s = now
            seen = self._measured(now, seen)
            self._judge(now, seen)
        elif self.proved and self._powered and now - self._read_s > PROOF_S:
            self.begin(now, max(self.stage, Stage.DIRECT), self.speed)
        if self.proved or self.stage is Stage.SILENCE:
            return None
        if seen is not None and seen.condition in OBEYING:
            self._disobeyed, self._obeyed_s = max(self._disobeyed - 1.0, 0.0), now
        elif seen is not None or not self._recently_obeyed(now):
            # However late a tick is, the drive missed only one opportunity to obey.
            self._disobeyed += min(dt / self._bounds.period_s, 2.0)
        self._follow(seen, dt)
        self.cut = self.cut or self._beyond_travel(seen)
        # Commanding a drive by SDO and reading its state takes three answers, one per tick.
        patience_ticks = self._bounds.ticks * self.stage
        if self._disobeyed < patience_ticks - ROUNDING and not self._out_of_time():
            return None
        self.stage, self._disobeyed = Stage(self.stage + 1), 0.0
        return self.stage

    def _recently_obeyed(self, now: float) -> bool:
        return now - self._obeyed_s <= (READING_TICKS + ROUNDING) * self._bounds.period_s

    # --- evidence of standstill --------------------------------------------------------------

    def _measured(self, now: float, seen: StopReading) -> StopReading:
        """Pass a reading to its witness; return it without velocity if it was not measured."""
        witness = self._witness(seen)
        witness.take(now, seen.velocity, seen.current, seen.position, seen.motor)
        return StopReading(seen.condition, math.nan, asked=seen.asked) if witness.repeats else seen

    def _witness(self, seen: StopReading) -> Witness:
        return self._asked if seen.asked else self.witness

    def _complete(self, seen: StopReading) -> bool:
        """True if a reading covers every sensor of the drive."""
        motor = self.witness.motor.known and math.isnan(seen.motor)
        return not (math.isnan(seen.velocity) or math.isnan(seen.position) or motor)

    def _judge(self, now: float, seen: StopReading) -> None:
        """Update the proof of standstill."""
        self._powered = seen.condition.powered
        self.moves = abs(seen.velocity) >= MOVES and self._powered
        if seen.condition not in OBEYING:
            if self.proved:
                self.begin(now, Stage.SETPOINT, seen.velocity)
            self._left_s, self._still, self._moving = math.nan, 0, 0
            return
        if math.isnan(self._left_s):
            self._left_s, self._left_speed = now, abs(seen.velocity)
        still = self._complete(seen) and self._witness(seen).stands(now, seen.velocity)
        self._still = self._still + 1 if still else max(self._still - STILL_LOST, 0)
        # Without power, motion is due to the load or a hand.
        calm = still or not seen.condition.powered or self._stops(now, seen)
        self._resisting = not calm and self._resists(seen)
        if not self._resisting:
            self._moving = _counted(self._moving, against=not calm)
        if not self.proved:
            if still and self._still >= self._needed and not self.runs_on:
                self.proved, self._disobeyed = True, 0.0
                self._stood, self._stood_s = seen.position, now
        elif self.runs_on or self._has_left(now, seen):
            # A hand that pushes a holding joint may make it oscillate again.
            self.proved, self._still = False, 0
            self._needed = min(max(2 * self._needed, STILL_AGAIN), STILL_MOST)
            self._left_s, self._left_speed, self._lowest_speed = now, abs(seen.velocity), math.inf

    def _has_left(self, now: float, seen: StopReading) -> bool:
        """True if it left its standstill position; its link may fall within the gap."""
        gone = abs(seen.position - self._stood) > LEEWAY * self._bounds.play + LEFT_RAD
        return gone or self._witness(seen).motor_moves(now, self._stood_s)

    def _stops(self, now: float, seen: StopReading) -> bool:
        """True if it decelerates along the ramp."""
        deceleration = RAMP_SHARE * self._bounds.deceleration
        ramp_s = now - self._left_s - RAMP_LAG_S
        bound = self._left_speed - deceleration * max(ramp_s, 0.0)
        swings = ramp_s < self._left_speed / deceleration + SWINGS_S
        speed = abs(seen.velocity)
        falls = speed <= (1.0 - FALLING_SHARE) * self._lowest_speed
        self._lowest_speed = min(self._lowest_speed, speed)
        return falls or speed <= max(bound, SWINGS if swings else STANDS)

    def _resists(self, seen: StopReading) -> bool:
        """True if it brakes near its current limit, against a push or oscillation: no evidence."""
        against = -math.copysign(1.0, seen.velocity) * seen.current
        return against >= RESISTING_SHARE * self._bounds.current

    # --- distance travelled ------------------------------------------------------------------

    def _follow(self, seen: StopReading | None, dt: float) -> None:
        """Track the distance travelled: by its sensors, or else by the last known speed, reduced
        along the ramp if the drive was recently observed to obey."""
        if seen is None or math.isnan(seen.velocity):
            braking = RAMP_SHARE * self._bounds.deceleration
            self._distance.coast(dt, braking if self._recently_obeyed(self._now_s) else 0.0)
            return
        positions = seen.position, seen.motor
        self._distance.take(dt, seen.velocity, seen.current, positions, resists=self._resisting)

    def _beyond_travel(self, seen: StopReading | None) -> bool:
        """True if it was beyond its travel for a stage, while running on or by its own power."""
        if seen is not None:
            # A pushed drive would go further without power.
            distance = self._distance
            counts = self.runs_on and not distance.pushed
            gone = max(distance.driven, distance.gone if counts else 0.0)
            self._beyond = _counted(self._beyond, against=gone > self._bounds.travel)
        return self._beyond >= self._bounds.ticks

    def _out_of_time(self) -> bool:
        """True if the remaining stages can no longer, or only just, stop it within its travel."""
        if self.stage is Stage.SETPOINT or not self._disobeyed:
            return False
        bounds, v = self._bounds, self.speed
        stage_s = bounds.ticks * bounds.period_s if self.stage is Stage.DIRECT else 0.0
        left_s = bounds.master_timeout_s + stage_s
        gone = self._distance.gone + v * left_s + v * v / (2.0 * bounds.deceleration)
        return gone > bounds.travel * (1.0 - ROUNDING)


def _counted(count: float, *, against: bool) -> float:
    return min(count + 1.0, MOST_READINGS) if against else max(count - CALM_SHARE, 0.0)
