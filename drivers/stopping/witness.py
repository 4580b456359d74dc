"""Witness of a standstill: history of one drive's motion by its sensors. Pure.

One sensor may repeat a value, be wrong, or be zero for ever. So a standstill needs two that agree:
a velocity that was seen to move and then to come down, or positions that were seen to change while
the motor moved and then to rest. A sample that repeats to the last bit although the motor moves, or
was commanded to, was not measured. Nor is a velocity that comes down more suddenly than a ramp and
friction stop a motor, or that fades while the motor's position rests, unless a sensor of motion
changes afterwards: what one failure takes away at once is one witness, even where the drive's
filter lets it fade. Time is an argument.
"""

import math
from copy import copy
from typing import Final

#: Slower than this a motor stands [rad/s at the link]: a few counts of a coarse velocity.
STANDS: Final = 0.02
#: A position rests that goes no further than a creeping motor in so long; some velocities have a
#: bias.
STILL_S: Final = 0.2
STILL_RAD: Final = STANDS * STILL_S
#: A velocity from here on [rad/s] is a motion, whatever its bias.
MOVES: Final = 0.1
#: Beside a velocity that came down, positions need to rest so long only [s].
PAUSE_S: Final = 0.03
#: Time until a setpoint shows in a motor that lags [s]; in the drive's samples it takes two ticks.
LAG_S: Final = 0.05
#: A motor that a soft loop no longer drives against friction may stick so far before the end of
#: setpoints slower than MOVES [rad].
STICKS_RAD: Final = 0.02
#: What was seen to move before a longer pause of its setpoints may be dead since [s].
BREAK_S: Final = 0.5
#: So many equal readings in a row while the motor moves were not measured.
FROZEN_READINGS: Final = 10
#: So many changed positions in a row are a motion, not counts of a coarse encoder.
MOVING_READINGS: Final = 3
#: Times are products of ticks [s].
ROUNDING_S: Final = 1e-6


class Position:
    """Position sensor of one drive: where it has rested, when it changed, and whether it ended in
    the middle of a motion."""

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
        """sudden: as of Witness."""
        self._sudden = sudden
        self.value = self.here = math.nan
        self.before_s = self.here_s = self.changed_s = self._sampled_s = math.nan
        self._changes = 0  # in a row
        self._speed = self._speed_before = 0.0  # of the last two [rad/s]
        self.died = False  # from a motion to rest within a sample, and it has rested since

    def take(self, now: float, value: float) -> bool:
        """Take a sample [rad]; NaN means none came. True if the value changed."""
        if math.isnan(value):
            return False
        elapsed_s, self._sampled_s = now - self._sampled_s, now
        if value == self.value:
            speed = min(self._speed, self._speed_before)  # a jump is no motion
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
        """True once there was a sample."""
        return not math.isnan(self.value)

    def rests(self, now: float, seconds: float) -> bool:
        """True if it has rested for so long; one that there is not does."""
        return math.isnan(self.value) or now - self.here_s >= seconds - ROUNDING_S

    @property
    def creeps(self) -> bool:
        """True if it last went STILL_RAD no faster than a motor that stands; or never did."""
        return not self.here_s - self.before_s < STILL_S


class Witness:
    """History of one drive's motion sensors and of its last setpoint that was a motion."""

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
        """sudden: deceleration that neither ramp nor friction explain [rad/s2 at the link]."""
        self._sudden = sudden
        self.link, self.motor = Position(sudden), Position(sudden)
        self._velocity = self._velocity_s = self._current = math.nan
        self._died = False  # its velocity came down as by a failure, and nothing has changed since
        # Way by its velocity since a position last changed, or since it was that of one that stands
        # for STILL_S: some have a bias.
        self._unseen_rad, self._fast_s = 0.0, -math.inf
        self._changed_s = -math.inf  # when any of it was last another than before
        self._same = 0  # readings since, of a motor that was to move or reported motion
        self._moved_s = -math.inf  # when its velocity last was a motion
        self._commanded_s = -math.inf  # when it was last commanded to move
        self._began_s = math.inf  # when that motion, with its short pauses, began
        # Way that it was commanded since a position last changed, and when it last was a command.
        self._commanded_rad, self._command_s = 0.0, -math.inf

    def copy(self) -> "Witness":
        """Another with the same history, which goes its own way."""
        other = copy(self)
        other.link, other.motor = copy(self.link), copy(self.motor)
        return other

    def command(self, now: float, velocity: float) -> None:
        """Take the target velocity [rad/s] in force from now on."""
        elapsed_s, self._command_s = min(abs(now - self._command_s), LAG_S), now
        if abs(velocity) >= STANDS:
            self._began_s = self._began_s if now - self._commanded_s <= BREAK_S else now
            self._commanded_s = now
            slow = abs(velocity) < MOVES
            self._commanded_rad += abs(velocity) * elapsed_s if slow else math.inf

    def take(
        self, now: float, velocity: float, current: float, link: float, motor: float = math.nan
    ) -> None:
        """Take fresh samples of a motor's velocity and current, and of its positions, SI at the
        link; NaN is none."""
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
        """True if all readings repeat to the last bit although its motor moves, or has since been
        commanded to."""
        return self._same >= FROZEN_READINGS

    def stands(self, now: float, velocity: float) -> bool:
        """True if all sensors agree that the motor stands, at this velocity [rad/s]."""
        speed = abs(velocity)
        if self._died or ((known := self._positions) and all(each.died for each in known)):
            return False
        if speed < STANDS and self._came_down:
            return self._rest(now, PAUSE_S)
        return speed < MOVES and self._follow and self._rest(now, STILL_S)

    def motor_moves(self, now: float, since: float) -> bool:
        """True if the motor's position goes on faster than that of one that stands, by what it did
        from the time `since` on."""
        motor = self.motor
        return motor.before_s >= since and not (motor.creeps or motor.rests(now, PAUSE_S))

    def _dies(self, now: float, velocity: float, moved: bool) -> bool:
        """True if the velocity comes, or came, down as by a failure; moved: a position changed."""
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
    def _came_down(self) -> bool:
        """True if its velocity was a motion for as long as its setpoint was."""
        return self._moved_s > -math.inf and self._moved_s >= self._commanded_s - LAG_S

    @property
    def _follow(self) -> bool:
        """True if one of its positions has changed for as long as it moved, or was to; but for the
        last of the way, if that position changed in this motion, and left its place in it or just
        before, as its velocity was seen."""
        began_s, recent_s = self._began_s, self._began_s - BREAK_S
        sticks = self._commanded_rad <= STICKS_RAD and self._fast_s >= recent_s
        for each in self._positions:
            left = each.before_s <= each.here_s >= recent_s  # not its first place
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
