"""Release of what the arm collided with: every joint that feels it gives way, slowly, the way it is
pushed. Pure; time is an argument.

All of them move at one constant speed, and each stops for good when it feels no more than its
contact level. A speed in proportion to the torque would be a loop around the stiffness of the clamp
and the delay of the residual, which swings against anything stiff; a speed that begins once and
ends once is no loop. Each joint moves the way its own torque points: so the power of all of them on
what presses is positive, and no point of contact is led into it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from arrays import Vector
from daemon.motion.limits import Limits

# Time beyond that of the whole distance, for ramps and for the end at a limit [s].
SLACK_S: Final = 1.0
# A joint that is as near as this to the end of its way has come to it [rad].
ARRIVED_RAD: Final = 0.01
# Ticks in a row until it counts that something presses from elsewhere, or that the sensing fails.
DEBOUNCE_TICKS: Final = 3
_END_OF: Final = {  # by `bounded` and `let_go`
    (True, False): "at a bound, and still pressed",
    (False, True): "let go",
    (False, False): "pressed from elsewhere while it let go",
}


@dataclass(frozen=True, slots=True)
class ReleaseSettings:
    """Bounds of a release."""

    velocity: float  # of each joint [rad/s]
    distance: float  # of each joint [rad]
    # By how much a setpoint may be ahead of its motor, (n,) [rad/s]: the drive of a joint that is
    # held by something stiff cannot follow at once, and must not be taken for deaf.
    ahead: Vector


class Release:
    """One release, from its beginning to its `end`; vectors of shape (n,)."""

    def __init__(self, bounds: ReleaseSettings, limits: Limits) -> None:
        n = len(limits.lower)
        self._bounds, self._limits = bounds, limits
        self._speed = np.minimum(bounds.velocity, limits.velocity)
        self._begun, self._pushed, self._way, self._followed = np.zeros((4, n))
        self._elapsed_s = 0.0
        self._against = self._unsure = 0
        self.end = ""
        """Why it is over, in words; empty while it goes on."""
        self.bounded = self.let_go = False
        """Over because of a bound, while something still presses; because nothing does."""

    def possible(self, q: Vector, thresholded: Vector) -> bool:
        """True if a joint that is pressed at q [rad] has room before its limit."""
        return bool(np.any((thresholded != 0.0) & (self._to_limit(q, thresholded) > ARRIVED_RAD)))

    def begin(self, q: Vector, thresholded: Vector) -> None:
        """Begin at q [rad], with the joints whose thresholded residual [Nm] is not zero."""
        self._begun = q.copy()
        self._pushed = np.sign(thresholded)
        self._way = self._pushed.copy()
        self._followed[:] = 0.0
        self._elapsed_s, self._against, self._unsure = 0.0, 0, 0
        self.end, self.bounded, self.let_go = "", False, False

    def step(
        self, q: Vector, motor_velocity: Vector, thresholded: Vector, dt: float, *, sure: bool
    ) -> None:
        """Take what is measured dt [s] after the last: link positions [rad], velocities of motors
        [rad/s], thresholded residual [Nm]; `sure` unless the last may be wrong."""
        self._elapsed_s += dt
        self._followed = np.maximum(self._pushed * motor_velocity, 0.0)
        self._unsure = 0 if sure else self._unsure + 1
        # From the other side, or at a joint that felt nothing when it began.
        against = np.count_nonzero((thresholded != 0.0) & (np.sign(thresholded) != self._pushed))
        self._against = self._against + 1 if against else 0
        pressed = self._way * thresholded > 0.0
        room = np.minimum(self._left(q), self._to_limit(q, self._pushed)) > ARRIVED_RAD
        self._way = np.where(pressed & room, self._way, 0.0)
        if self._unsure >= DEBOUNCE_TICKS:
            self.end = "what the arm feels is not sure"
        elif self._against >= DEBOUNCE_TICKS:
            self.end = _END_OF[False, False]
        elif self._elapsed_s > self._bounds.distance / self._bounds.velocity + SLACK_S:
            self.end, self.bounded = f"not let go within {self._elapsed_s:.1f} s", True
        elif not self._way.any():
            self.bounded = bool(np.any(thresholded * self._pushed > 0.0))
            self.let_go = not (self.bounded or against)
            self.end = _END_OF[self.bounded, self.let_go]

    def velocity(self, q: Vector) -> Vector:
        """Desired velocity [rad/s] at q [rad]; it sinks towards the end of the distance, and waits
        for the motors."""
        speed = np.minimum(self._speed, self._followed + self._bounds.ahead)
        slowed: Vector = np.minimum(speed, self._limits.funnel(self._left(q)))
        return self._way * slowed

    def rest(self, q: Vector, before: Vector, thresholded: Vector) -> Vector:
        """Where to hold [rad], of q and an earlier position: where each joint is further away from
        what it let go of, unless it is pressed back. A link that fell back through its gap is not
        pressed on to it again."""
        away = (self._pushed * (before - q) > 0.0) & (self._pushed * thresholded >= 0.0)
        further: Vector = np.where(away, before, q)
        return further

    def _left(self, q: Vector) -> Vector:
        """What is left of the distance [rad]."""
        left: Vector = self._bounds.distance - self._pushed * (q - self._begun)
        return left

    def _to_limit(self, q: Vector, push: Vector) -> Vector:
        """What is left to the joint limit the way of the push [rad]."""
        limits = self._limits
        room: Vector = np.where(push > 0.0, limits.upper - q, q - limits.lower)
        return room
