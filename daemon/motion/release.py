"""Release after a collision: every joint in contact moves slowly the way it is pushed. Pure; time
is an argument.

All of them move at one constant speed, and each stops for good when its residual falls to its
stated contact level. Learning alone starts no release: the residual without learned friction must
show the contact, too. A speed proportional to the torque would close a loop around the stiffness of
the clamp and the delay of the residual, which oscillates against anything stiff; a speed that
starts once and ends once closes no loop. Each joint moves in the direction of its external torque:
the obstacle thus does positive work on the arm, and no point of contact is moved into it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.modes.release_stage import Ending
from daemon.motion.limits import Limits

# Time beyond that for the whole distance, for ramps and for slowing down at a limit [s].
SLACK_S: Final = 1.0
# Distance from the end of its travel at which a joint counts as arrived [rad].
ARRIVED_RAD: Final = 0.01
# Consecutive ticks until pressure from elsewhere counts.
DEBOUNCE_TICKS: Final = 3
# Longest pause while sensing is not reliable [s]; reliable time is subtracted, so that all pauses
# together are no longer than the motion plus this.
PAUSE_S: Final = 0.5


@dataclass(frozen=True, slots=True)
class ReleaseSettings:
    """Bounds of a release."""

    velocity: float  # of each joint [rad/s]
    distance: float  # of each joint [rad]
    # Largest lead of a setpoint over its motor, (n,) [rad/s]: the drive of a joint that is held by
    # something stiff cannot follow at once, and must not be reported as not following.
    ahead: Vector


class Release:
    """One release, from its beginning to its `end`; vectors of shape (n,)."""

    def __init__(self, bounds: ReleaseSettings, limits: Limits) -> None:
        n = len(limits.lower)
        self._bounds, self._limits = bounds, limits
        self._speed = np.minimum(bounds.velocity, limits.velocity)
        self._begun, self._pushed, self._moving, self._followed, self._residual = np.zeros((5, n))
        self._elapsed_s = self._unsure_s = 0.0
        self._against, self._sure = 0, True
        self.end: Ending | None = None
        """None during the release"""

    def possible(self, q: Vector, thresholded: Vector) -> bool:
        """True if a pressed joint at q [rad] has room before its limit."""
        return bool(np.any((thresholded != 0.0) & (self._to_limit(q, thresholded) > ARRIVED_RAD)))

    def begin(self, q: Vector, thresholded: Vector, residual: Vector) -> None:
        """Begin at q [rad], with the joints whose thresholded residual [Nm] is not zero.

        A joint that moved with the same push since `forget` has only the rest of its distance.
        """
        pushed = np.sign(thresholded)
        again = (pushed != 0.0) & (pushed == self._pushed)
        self._begun = np.where(again, self._begun, q)
        self._pushed, self._residual = pushed, residual.copy()
        self._moving = pushed.copy()  # sign of the velocity; 0 once a joint has stopped
        self._followed[:] = 0.0
        self._elapsed_s, self._unsure_s, self._against, self._sure = 0.0, 0.0, 0, True
        self.end = None

    def forget(self) -> None:
        """End the contact: the next push counts as another one."""
        self._pushed[:] = 0.0

    def step(
        self, q: Vector, motor_velocity: Vector, thresholded: Vector, dt: float, *, sure: bool
    ) -> None:
        """Process the measurements dt [s] after the last: link positions [rad], velocities of
        motors [rad/s], thresholded residual [Nm]. Unless `sure`, they may be wrong or old, and the
        release pauses."""
        self._sure = sure
        if not sure:
            self._unsure_s += dt
            if self._unsure_s > PAUSE_S:
                self.end = Ending.UNSURE
            return
        self._unsure_s = max(self._unsure_s - dt, 0.0)
        self._elapsed_s += dt
        self._followed = np.maximum(self._pushed * motor_velocity, 0.0)
        against = bool(self._elsewhere(thresholded).any())
        self._against = self._against + 1 if against else 0
        pressed = self._moving * thresholded > 0.0
        room = np.minimum(self._left(q), self._to_limit(q, self._pushed)) > ARRIVED_RAD
        self._moving = np.where(pressed & room, self._moving, 0.0)
        if self._against >= DEBOUNCE_TICKS:
            self.end = Ending.ELSEWHERE
        elif not self._moving.any():
            bounded = bool(np.any(thresholded * self._pushed > 0.0))
            self.end = (
                Ending.BOUND if bounded else Ending.ELSEWHERE if against else Ending.CONTACT_ENDED
            )
        elif self._elapsed_s > self._bounds.distance / self._bounds.velocity + SLACK_S:
            self.end = Ending.TIME

    def in_words(
        self, joints: Sequence[str], q: Vector, thresholded: Vector, residual: Vector
    ) -> str:
        """Description of the end, with joints and torques, from the present measurements."""

        def contacts(which: NDArray[np.bool_]) -> str:
            named = (
                f"{residual[i]:+.1f} Nm at {joints[i]}" for i in np.flatnonzero(which).tolist()
            )
            return ", ".join(named)

        gave = f"after giving way by {np.abs(q - self._begun)[self._pushed != 0.0].max():.2f} rad"
        match self.end:
            case Ending.CONTACT_ENDED:
                pushed = np.flatnonzero(self._pushed).tolist()
                ended = (f"{joints[i]} ({self._residual[i]:+.1f} Nm)" for i in pushed)
                return f"let go of contact at {', '.join(ended)}"
            case Ending.BOUND:
                still = contacts(thresholded * self._pushed > 0.0)
                return f"still pressed with {still} {gave}"
            case Ending.TIME:
                still = contacts(thresholded * self._pushed > 0.0)
                return f"still pressed with {still} {gave} for {self._elapsed_s:.1f} s"
            case Ending.ELSEWHERE:
                elsewhere = contacts(self._elsewhere(thresholded))
                return f"pressed from elsewhere while it let go: contact of {elsewhere}"
            case Ending.UNSURE:
                return f"sensing was not reliable for {PAUSE_S:g} s while it let go"
            case None:
                return ""

    def velocity(self, q: Vector) -> Vector:
        """Desired velocity [rad/s] at q [rad]: decreasing towards the end of the distance, at most
        `ahead` of the motors' velocity, and zero while torques may be old."""
        if not self._sure:
            return np.zeros_like(q)
        speed = np.minimum(self._speed, self._followed + self._bounds.ahead)
        slowed: Vector = np.minimum(speed, self._limits.funnel(self._left(q)))
        return self._moving * slowed

    def rest(self, q: Vector, before: Vector, thresholded: Vector) -> Vector:
        """Position to hold [rad]: for each joint, of q and an earlier position, the one further
        away from the contact, unless the joint is pressed back. A link that fell back through its
        gap is thus not pressed against the contact again."""
        away = (self._pushed * (before - q) > 0.0) & (self._pushed * thresholded >= 0.0)
        further: Vector = np.where(away, before, q)
        return further

    def _elsewhere(self, thresholded: Vector) -> NDArray[np.bool_]:
        """Joints pressed from the other side, or without contact when the release began."""
        other: NDArray[np.bool_] = (thresholded != 0.0) & (np.sign(thresholded) != self._pushed)
        return other

    def _left(self, q: Vector) -> Vector:
        """Remaining part of the distance [rad]."""
        left: Vector = self._bounds.distance - self._pushed * (q - self._begun)
        return left

    def _to_limit(self, q: Vector, push: Vector) -> Vector:
        """Distance to the joint limit in the direction of the push [rad]."""
        limits = self._limits
        room: Vector = np.where(push > 0.0, limits.upper - q, q - limits.lower)
        return room
