"""Stop of one drive in stages, each with a deadline; only an observed standstill ends it. Pure.

A drive that was commanded to stop stands when fresh readings confirm it: a report that it obeys,
and every sensor that it has (`witness`). Until then it counts as running. The stages get stronger,
and none relies on what the one before needs; what each sends is the make's. Time is an argument.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from drivers.api import DriveCondition
from drivers.stopping.distance import Distance
from drivers.stopping.witness import MOVES, STANDS, Witness

#: Readings, less so many for each other one, so that noise proves nothing.
STILL_READINGS: Final = 2
STILL_LOST: Final = 4
#: The same after a proof that motion ended; after another, twice as many, and so on, at most.
STILL_AGAIN: Final = 20
STILL_MOST: Final = 160
#: Lowest deceleration of a quick stop as a share of its ramp: the load pulls, the loop lags.
RAMP_SHARE: Final = 0.5
#: Longest time until the ramp begins [s].
RAMP_LAG_S: Final = 0.02
#: Speed at which a motor may swing after its ramp [rad/s].
SWINGS: Final = 0.1
#: Longest time for which it may swing [s]: its link falls to and fro in the gap.
SWINGS_S: Final = 1.0
#: Ticks are quotients of times, travels products.
ROUNDING: Final = 0.01
#: A drive that was seen to obey needs to be seen again so many ticks later: slow ones take three to
#: answer one SDO, and samples are lost in bursts.
READING_TICKS: Final = 10
#: A motor that was knocked off its ramp gets slower than it ever was by this share.
FALLING_SHARE: Final = 0.03
#: A motor that gives this share of its current limit against its motion resists as it can.
RESISTING_SHARE: Final = 0.5
#: After so many contrary readings, less the others, it counts as running on, and its proof is void.
VOID_READINGS: Final = 20
#: At most so many count, and one that is not contrary takes a share away: slips are short.
MOST_READINGS: Final = 25.0
CALM_SHARE: Final = 0.25
#: The proof of a drive under power is void after so long without a reading [s].
PROOF_S: Final = 0.3
#: A link is no longer where it stood from so far beyond its gap on [rad], identified to so much.
LEFT_RAD: Final = 0.02
LEEWAY: Final = 1.5
#: No ramp and no friction stops a motor with more than so many times the deceleration of its ramp.
SUDDEN_SHARE: Final = 3.0
#: Conditions of a drive that obeys a stop: without power, or stopping and holding by itself.
OBEYING: Final = frozenset(
    {
        *(condition for condition in DriveCondition if not condition.powered),
        *(DriveCondition.STOPPED, DriveCondition.FAILING),
    }
)


class Stage(IntEnum):
    """Stages of a stop, in rising order of strength."""

    NONE = 0  # the drive may run
    SETPOINT = 1  # stop among the setpoints
    DIRECT = 2  # stop by a command of its own
    LAST = 3  # strongest command that there is
    SILENCE = 4  # nothing is sent any more, so that the drive's own watch on us acts


@dataclass(frozen=True, slots=True)
class Seen:
    """Fresh reading of a drive that is to stop. SI at the link; NaN where it was not read."""

    condition: DriveCondition
    velocity: float  # of the motor
    current: float = math.nan
    position: float = math.nan  # of the link
    motor: float = math.nan  # position of the motor, where it has a sensor of its own
    asked: bool = False  # read on its own, not as a sample


@dataclass(frozen=True, slots=True)
class StopBounds:
    """Bounds of one drive's stop, at the link: deceleration, current, time and travel."""

    deceleration: float  # of its quick stop [rad/s2]
    current: float  # its limit [A]
    travel: float  # of its joint, from the first command on [rad]
    play: float  # of its link about its motor [rad]
    patience_s: float  # until it stops by itself when it misses us
    ticks: int  # of each stage
    period_s: float
    falls: bool = False  # its joint does when its power is cut, so that two sensors must ask for it


class StopWatch:
    """Watch on one drive: checks that it obeys a command to stop.

    Stronger stages are for a drive that is in operation, or unheard. One that reports that it stops
    gets none for being moved: they ask of it what it does already, and would cost the others their
    master. Once it runs on beyond its travel its power is to be `cut`, as where a
    monitored ramp is not kept (SS1-r of IEC 61800-5-2). It stands only when it is seen to.
    """

    stage: Stage
    proved: bool
    """It was seen to stand, and nothing against it since."""
    cut: bool
    """Its quick stop does not stop it within its travel: it is to be without power."""
    moves: bool
    """Its last reading is a motion under power, whatever was proved."""
    _read_s: float  # when it was last read
    _powered: bool  # then
    _wrong: float  # ticks without obedience, less those with
    _now_s: float
    _resisting: bool  # it brakes as it can, and does not slow down
    _obeyed_s: float  # when it was last seen to
    _left_s: float  # when it was seen to have left operation
    _left_speed: float  # its speed then [rad/s]
    _least: float  # lowest speed since [rad/s]
    _stood: float  # position of the link when it was seen to stand [rad]
    _stood_s: float
    _still: int  # readings that show a standstill, less STILL_LOST for each other
    _needed: int  # of them for a proof
    _moving: float  # readings that show it running on, less those that do not
    _beyond: float  # likewise, of those that were taken beyond its travel
    _asked: Witness  # of the readings on its own since the command to stop

    def __init__(self, bounds: StopBounds) -> None:
        self._bounds = bounds
        self._distance = Distance(bounds.travel, falls=bounds.falls)
        self.witness = Witness(SUDDEN_SHARE * bounds.deceleration)
        """Witness of its samples, while it runs, too."""
        self.begin(math.nan, Stage.NONE, math.nan)

    @property
    def unproved(self) -> bool:
        """True while it was commanded to stop and is not confirmed at standstill."""
        return self.stage is not Stage.NONE and not self.proved

    @property
    def speed(self) -> float:
        """The last that is known [rad/s]."""
        return self._distance.speed

    @property
    def runs_on(self) -> bool:
        """True while it reports that it stops, but moves as if it did not."""
        return self._moving >= VOID_READINGS

    def begin(self, now: float, stage: Stage, speed: float) -> None:
        """Begin a stop in this stage, from the last known `speed` [rad/s], at the positions of its
        last samples. Earlier proof is void."""
        self.stage, self.proved, self.cut, self.moves = stage, False, False, False
        self._wrong, self._now_s = 0.0, now
        self._read_s, self._powered = now, True
        self._distance.begin(self.witness.link.value, self.witness.motor.value, speed)
        self._resisting = False
        self._left_s, self._obeyed_s, self._least = math.nan, -math.inf, math.inf
        self._stood = self._stood_s = math.nan
        self._still, self._moving, self._beyond = 0, 0.0, 0.0
        self._needed = STILL_READINGS
        # The history of readings on their own goes on from that of the samples.
        self._asked = self.witness.copy()

    def allow(self) -> None:
        """It may run."""
        self.stage, self.proved, self.cut, self.moves = Stage.NONE, False, False, False

    def step(self, now: float, seen: Seen | None) -> Stage | None:
        """Judge what was seen since the last tick (None: nothing fresh), after `begin`. Returns the
        stage that begins, None while none does."""
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
            self._wrong, self._obeyed_s = max(self._wrong - 1.0, 0.0), now
        elif seen is not None or not self._lately_obeyed(now):
            # However late a tick is, it is one chance that the drive was not given.
            self._wrong += min(dt / self._bounds.period_s, 2.0)
        self._follow(seen, dt)
        self.cut = self.cut or self._goes_further(seen)
        # Commanding a drive by SDO and reading its state takes an answer in each of three ticks.
        patience_ticks = self._bounds.ticks * self.stage
        if self._wrong < patience_ticks - ROUNDING and not self._runs_out():
            return None
        self.stage, self._wrong = Stage(self.stage + 1), 0.0
        return self.stage

    def _lately_obeyed(self, now: float) -> bool:
        return now - self._obeyed_s <= (READING_TICKS + ROUNDING) * self._bounds.period_s

    # --- what a reading proves ---------------------------------------------------------------

    def _measured(self, now: float, seen: Seen) -> Seen:
        """Take the readings of its sensors, and return those that were measured."""
        witness = self._witness(seen)
        witness.take(now, seen.velocity, seen.current, seen.position, seen.motor)
        return Seen(seen.condition, math.nan, asked=seen.asked) if witness.repeats else seen

    def _witness(self, seen: Seen) -> Witness:
        return self._asked if seen.asked else self.witness

    def _complete(self, seen: Seen) -> bool:
        """True if every sensor that it has is in a reading."""
        motor = self.witness.motor.known and math.isnan(seen.motor)
        return not (math.isnan(seen.velocity) or math.isnan(seen.position) or motor)

    def _judge(self, now: float, seen: Seen) -> None:
        """Keep whether it is proved to stand."""
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
        # Without power it moves as the load or a hand will.
        calm = still or not seen.condition.powered or self._stops(now, seen)
        self._resisting = not calm and self._resists(seen)
        if not self._resisting:
            self._moving = _counted(self._moving, against=not calm)
        if not self.proved:
            if still and self._still >= self._needed and not self.runs_on:
                self.proved, self._wrong = True, 0.0
                self._stood, self._stood_s = seen.position, now
        elif self.runs_on or self._has_left(now, seen):
            # A hand that pushes what holds may make it swing anew.
            self.proved, self._still = False, 0
            self._needed = min(max(2 * self._needed, STILL_AGAIN), STILL_MOST)
            self._left_s, self._left_speed, self._least = now, abs(seen.velocity), math.inf

    def _has_left(self, now: float, seen: Seen) -> bool:
        """True if it is not where it stood; its link may fall within its gap."""
        gone = abs(seen.position - self._stood) > LEEWAY * self._bounds.play + LEFT_RAD
        return gone or self._witness(seen).motor_moves(now, self._stood_s)

    def _stops(self, now: float, seen: Seen) -> bool:
        """True if it slows down along the ramp."""
        deceleration = RAMP_SHARE * self._bounds.deceleration
        ramp_s = now - self._left_s - RAMP_LAG_S
        bound = self._left_speed - deceleration * max(ramp_s, 0.0)
        swings = ramp_s < self._left_speed / deceleration + SWINGS_S
        speed = abs(seen.velocity)
        falls = speed <= (1.0 - FALLING_SHARE) * self._least
        self._least = min(self._least, speed)
        return falls or speed <= max(bound, SWINGS if swings else STANDS)

    def _resists(self, seen: Seen) -> bool:
        """True if it brakes as it can, against a person or because it swings: no evidence."""
        against = -math.copysign(1.0, seen.velocity) * seen.current
        return against >= RESISTING_SHARE * self._bounds.current

    # --- how far it goes ---------------------------------------------------------------------

    def _follow(self, seen: Seen | None, dt: float) -> None:
        """Track the distance travelled: by its sensors; without them, by the last known speed,
        reduced along the ramp if the drive was seen to obey it."""
        if seen is None or math.isnan(seen.velocity):
            braking = RAMP_SHARE * self._bounds.deceleration
            self._distance.coast(dt, braking if self._lately_obeyed(self._now_s) else 0.0)
            return
        positions = seen.position, seen.motor
        self._distance.take(dt, seen.velocity, seen.current, positions, resists=self._resisting)

    def _goes_further(self, seen: Seen | None) -> bool:
        """True if it went beyond its travel, running on or in all by its own power, for a stage."""
        if seen is not None:
            # Without power a drive that is pushed would go further.
            distance = self._distance
            counts = self.runs_on and not distance.pushed
            gone = max(distance.driven, distance.gone if counts else 0.0)
            self._beyond = _counted(self._beyond, against=gone > self._bounds.travel)
        return self._beyond >= self._bounds.ticks

    def _runs_out(self) -> bool:
        """True if the stages after this one could only just stop it within its travel."""
        if self.stage is Stage.SETPOINT or not self._wrong:
            return False
        bounds, v = self._bounds, self.speed
        stage_s = bounds.ticks * bounds.period_s if self.stage is Stage.DIRECT else 0.0
        left_s = bounds.patience_s + stage_s
        gone = self._distance.gone + v * left_s + v * v / (2.0 * bounds.deceleration)
        return gone > bounds.travel * (1.0 - ROUNDING)


def _counted(count: float, *, against: bool) -> float:
    return min(count + 1.0, MOST_READINGS) if against else max(count - CALM_SHARE, 0.0)
