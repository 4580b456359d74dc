"""Witness of a standstill: motion history of one drive from its sensors. Pure.

A single sensor may freeze, be wrong, or read zero permanently. So a standstill needs two that
agree: a velocity that was observed to move and then to fall, or positions that were observed to
change while the motor moved and then to rest. A sample that repeats to the last bit although the
motor moves, or was commanded to, was not measured. Nor was a velocity that falls faster than ramp
and friction can decelerate a motor, or that decays while the motor position rests, unless a motion
sensor changes afterwards: sensors that one failure silences together are one witness, even if the
drive's filter makes the signal decay. Time is an argument.
"""

import math
from copy import copy
from typing import Final

#: A motor below this speed is at standstill [rad/s at the link]: some counts of a coarse velocity.
STANDS: Final = 0.02
#: A position rests if it changes by no more than STILL_RAD in STILL_S; some velocities are biased.
STILL_S: Final = 0.2
STILL_RAD: Final = STANDS * STILL_S
#: A velocity from this value on is motion, whatever its bias [rad/s].
MOVES: Final = 0.1
#: Rest time of the positions that suffices after a velocity was observed to fall [s]; over the time
#: of their last change, as what creeps changes again as soon; and at most, at 0.04 rad/s.
PAUSE_S: Final = 0.03
LONGER: Final = 1.5
LONGEST_S: Final = 0.1
#: Lag of a motor behind its setpoint [s]; it takes two ticks to show in the samples.
LAG_S: Final = 0.05
#: With setpoints below MOVES a motor under a soft loop may stick in friction so far before their
#: end [rad].
STICKS_RAD: Final = 0.02
#: A sensor that moved before a longer pause of the setpoints may have failed since [s].
BREAK_S: Final = 0.5
#: Consecutive equal readings while the motor moves from which they count as not measured.
FROZEN_READINGS: Final = 10
#: Consecutive position changes from which they count as motion, not counts of a coarse encoder.
MOVING_READINGS: Final = 3
#: Tolerance for times, which are products of ticks [s].
ROUNDING_S: Final = 1e-6


class Position:
    """Position sensor of one drive: where it rests, when it changed, and whether it froze during a
    motion."""

    __slots__ = (
        "_changes",
        "_sampled_s",
        "_speed",
        "_speed_before",
        "_sudden",
        "before_s",
        "changed_s",
        "died",
        "here",
        "here_s",
        "value",
    )

    def __init__(self, sudden: float = math.inf) -> None:
        """sudden: as for Witness."""
        self._sudden = sudden
        self.value = self.here = math.nan
        self.before_s = self.here_s = self.changed_s = self._sampled_s = math.nan
        self._changes = 0  # consecutive
        self._speed = self._speed_before = 0.0  # of the last two changes [rad/s]
        self.died = False  # it went from motion to rest within one sample, and has rested since

    def take(self, now: float, value: float) -> bool:
        """Take a sample [rad]; NaN means none arrived. True if the value changed."""
        if math.isnan(value):
            return False
        elapsed_s, self._sampled_s = now - self._sampled_s, now
        if value == self.value:
            speed = min(self._speed, self._speed_before)  # a single jump is no motion
            if self._changes >= MOVING_READINGS and speed > self._sudden * elapsed_s > 0.0:
                self.died = True
            self._changes = self._changes if elapsed_s <= 0.0 else 0
            return False
        self._speed_before = self._speed
        self._speed = abs(value - self.value) / elapsed_s if elapsed_s > 0.0 else 0.0
        self._changes, self.died = self._changes + 1, False
        self.changed_s, self.value = now, value
        if not abs(value - self.here) <= STILL_RAD:
            self.here, self.here_s, self.before_s = value, now, self.here_s
        return True

    @property
    def known(self) -> bool:
        """True once a sample has arrived."""
        return not math.isnan(self.value)

    def rests(self, now: float, seconds: float) -> bool:
        """True if it has rested for `seconds`, or has never had a sample."""
        return math.isnan(self.value) or now - self.here_s >= seconds - ROUNDING_S

    @property
    def pause_s(self) -> float:
        """Rest time [s] after a velocity fell: longer than the last change by STILL_RAD took."""
        return max(PAUSE_S, min(LONGER * (self.here_s - self.before_s), LONGEST_S))

    @property
    def creeps(self) -> bool:
        """True if its last change by STILL_RAD took STILL_S or more, or has not occurred."""
        return not self.here_s - self.before_s < STILL_S


class Witness:
    """History of one drive's motion sensors, and of its last setpoints that commanded motion."""

    __slots__ = (
        "_began_s",
        "_changed_s",
        "_command_s",
        "_commanded_rad",
        "_commanded_s",
        "_current",
        "_died",
        "_fast_s",
        "_moved_s",
        "_same",
        "_sudden",
        "_unseen_rad",
        "_velocity",
        "_velocity_s",
        "link",
        "motor",
    )

    def __init__(self, sudden: float = math.inf) -> None:
        """sudden: deceleration that ramp and friction cannot explain [rad/s2 at the link]."""
        self._sudden = sudden
        self.link, self.motor = Position(sudden), Position(sudden)
        self._velocity = self._velocity_s = self._current = math.nan
        self._died = False  # its velocity fell as if by a failure, and nothing has changed since
        # Integral of its velocity since a position last changed, or since the velocity last was at
        # standstill for STILL_S (some are biased); and the last time that it was not.
        self._unseen_rad, self._fast_s = 0.0, -math.inf
        self._changed_s = -math.inf  # last change of any reading
        self._same = 0  # equal readings since, of a motor that reports or was commanded motion
        self._moved_s = -math.inf  # last time that its velocity was motion
        self._commanded_s = -math.inf  # last time that it was commanded to move
        self._began_s = math.inf  # begin of that commanded motion, short pauses included
        # Commanded distance since a position last changed, and time of the last command.
        self._commanded_rad, self._command_s = 0.0, -math.inf

    def copy(self) -> "Witness":
        """Independent copy with the same history."""
        other = copy(self)
        other.link, other.motor = copy(self.link), copy(self.motor)
        return other

    def command(self, now: float, velocity: float) -> None:
        """Take the target velocity [rad/s] that applies from now on."""
        elapsed_s, self._command_s = min(abs(now - self._command_s), LAG_S), now
        if abs(velocity) >= STANDS:
            self._began_s = self._began_s if now - self._commanded_s <= BREAK_S else now
            self._commanded_s = now
            slow = abs(velocity) < MOVES
            self._commanded_rad += abs(velocity) * elapsed_s if slow else math.inf

    def take(
        self, now: float, velocity: float, current: float, link: float, motor: float = math.nan
    ) -> None:
        """Take fresh samples of motor velocity and current, and of link and motor position, in SI
        units at the link; NaN means none."""
        changed = self.link.take(now, link)
        changed = self.motor.take(now, motor) or changed
        self._commanded_rad = 0.0 if changed else self._commanded_rad
        if not math.isnan(velocity):
            self._died = self._dies(now, velocity, changed)
            changed = changed or velocity != self._velocity
            self._velocity, self._velocity_s = velocity, now
        elif changed:
            self._died = False
        if current != self._current and not math.isnan(current):
            self._current, changed = current, True
        if abs(velocity) >= MOVES:
            self._moved_s = now
        if changed:
            self._changed_s, self._same = now, 0
        elif max(self._moved_s, self._commanded_s) > self._changed_s:
            self._same += 1

    @property
    def repeats(self) -> bool:
        """True if all readings repeat to the last bit although the motor reported motion or has
        since been commanded to move."""
        return self._same >= FROZEN_READINGS

    def stands(self, now: float, velocity: float) -> bool:
        """True if all sensors agree on a standstill of the motor, at this velocity [rad/s]."""
        speed = abs(velocity)
        if self._died or ((known := self._positions) and all(each.died for each in known)):
            return False
        if speed < STANDS and self._velocity_fell:
            # A velocity that died leaves positions that move on, less than STILL_RAD in PAUSE_S.
            return all(each.rests(now, each.pause_s) for each in (self.link, self.motor))
        return speed < MOVES and self._position_followed and self._rest(now, STILL_S)

    def motor_moves(self, now: float, since: float) -> bool:
        """True if the motor position moves faster than at standstill, judged by its changes from
        the time `since` on."""
        motor = self.motor
        return motor.before_s >= since and not (motor.creeps or motor.rests(now, PAUSE_S))

    def _dies(self, now: float, velocity: float, moved: bool) -> bool:
        """True if the velocity falls, or fell, as if by a failure; moved: a position changed."""
        speed, before, elapsed_s = abs(velocity), abs(self._velocity), now - self._velocity_s
        self._fast_s = now if speed >= STANDS else self._fast_s
        rests = moved or now - self._fast_s > STILL_S
        self._unseen_rad = 0.0 if rests else self._unseen_rad + before * elapsed_s
        if velocity == self._velocity:
            return self._died and not moved
        if before >= MOVES and before - speed > self._sudden * elapsed_s:
            return not self.repeats
        fades = speed < before and velocity * self._velocity >= 0.0
        unseen = self.motor.known and self._unseen_rad > STILL_RAD
        return fades and not moved and (self._died or unseen)

    @property
    def _velocity_fell(self) -> bool:
        """True if its velocity was motion until the end of the commanded motion."""
        return self._moved_s > -math.inf and self._moved_s >= self._commanded_s - LAG_S

    @property
    def _position_followed(self) -> bool:
        """True if one of its positions changed until the end of its measured and commanded motion.
        The last STICKS_RAD are forgiven if that position changed in this motion, and both it and
        the velocity moved in it or just before."""
        began_s, recent_s = self._began_s, self._began_s - BREAK_S
        sticks = self._commanded_rad <= STICKS_RAD and self._fast_s >= recent_s
        for each in self._positions:
            left = each.before_s <= each.here_s >= recent_s  # False before its first change
            forgiven = sticks and left and each.changed_s >= began_s
            moved_s = self._moved_s if forgiven else max(self._moved_s, self._commanded_s)
            if each.changed_s >= moved_s - LAG_S:
                return True
        return False

    @property
    def _positions(self) -> list[Position]:
        return [each for each in (self.link, self.motor) if each.known]

    def _rest(self, now: float, seconds: float) -> bool:
        return self.link.rests(now, seconds) and self.motor.rests(now, seconds)
