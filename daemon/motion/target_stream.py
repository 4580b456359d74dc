"""Stream of targets that the arm follows: a trajectory that a client generates while it runs.

The arm joins the stream slowly, follows it, brakes while no target comes, and waits where it stands
after a contact, or while the target is out of reach. `Limits` bounds its setpoints, like all
others.

Pure; time is counted in ticks. As a JointPath it has no end and requires no pose, so that it may
begin and continue anywhere.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np

from common.arrays import Vector
from daemon.motion.limits import Limits
from daemon.motion.path import Reference
from daemon.motion.playout import Playout, Target
from daemon.motion.tracker import LAG_S, Tracker

# Share of the acceleration limit that the stream may use; the position loop has the rest.
STREAM_SHARE: Final = 0.8
# Distance of the furthest joint from its target at which the arm has joined the stream, and at
# which it joins again by itself after a contact [rad].
NEAR_RAD: Final = 0.05
# Distance within which a stream that was silent for a moment is followed again at once [rad].
RESUMED_RAD: Final = 0.15
# Ratio to the velocity limit from which on a stream counts as faster: jitter adds to its velocity.
FASTER: Final = 1.5
# Silence after which the arm brakes [s], and after which the stream has stalled: at 20 Hz more
# than two consecutive targets lost.
BRAKED_S: Final = 0.14
STALLED_S: Final = 0.175
# Time for which a contact is reported after its end, so that a slow sender receives it [s].
SAID_S: Final = 0.5
# Silence after which the stream has ended [s].
ENDED_S: Final = 0.5


class AfterContact(StrEnum):
    """Continuation of a stream when a contact is over, and quiet."""

    HOLD = "hold"  # holds until the stream is near the arm again, or is requested again
    REJOIN = "rejoin"  # moves slowly to the stream


class Phase(StrEnum):
    """Phase of the arm on a stream."""

    JOINING = "joining"  # moves slowly to the target
    FOLLOWING = "following"
    STALLED = "stalled"  # has braked to standstill: no target came for STALLED_S
    WAITING = "waiting"  # stands until the stream is near, or is requested again


CAUSES: Final = {
    Phase.JOINING: "the arm is apart from it",
    Phase.FOLLOWING: "the arm is near it",
    Phase.STALLED: f"no target for {STALLED_S:g} s",
    Phase.WAITING: f"until it is within {NEAR_RAD:g} rad of the arm, or is asked to rejoin",
}
STANDING: Final = frozenset({Phase.STALLED, Phase.WAITING})


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """Configured behaviour of streams."""

    after_contact: AfterContact
    reach: float  # largest distance of a target that is approached [rad]
    join_velocity: float  # [rad/s]


def next_phase(phase: Phase, *, silent: bool, apart: float, newest: float, reach: float) -> Phase:
    """Phase of the next tick. silent: no target comes; apart: distance of the furthest joint from
    the interpolated target [rad], which is approached within `reach` [rad]; newest: the same, from
    the newest target, as a stream that jumps across the arm is near it only between two targets."""
    near = max(apart, newest) < NEAR_RAD
    match phase:
        case Phase.WAITING:
            return Phase.JOINING if near and not silent else phase
        case _ if silent:
            return Phase.STALLED
        case _ if apart > reach:
            return Phase.WAITING
        case Phase.STALLED:
            resumed = max(apart, newest) < RESUMED_RAD
            return Phase.FOLLOWING if resumed else Phase.JOINING
        case Phase.JOINING:
            joined = apart < NEAR_RAD and newest < RESUMED_RAD
            return Phase.FOLLOWING if joined else phase
        case Phase.FOLLOWING:
            return phase


@dataclass(slots=True)
class TargetStream:
    """Stream of one sender, as a JointPath; vectors (n,)."""

    sender: str
    settings: StreamSettings
    limits: Limits
    first: Target
    phase: Phase = Phase.JOINING
    bounded: int = 0  # targets outside the joint limits, or too fast
    refused: int = 0  # targets that are not finite
    name: str = "a stream"
    duration: float = math.inf
    begin: Vector | None = None
    motors_only: bool = False
    halts_at_contact: bool = False
    playout: Playout = field(init=False)
    _tracker: Tracker | None = None
    _braked: bool = False
    _rejoins: bool = False
    _now_s: float = 0.0
    _heard_s: float = 0.0
    _period_s: float = 0.0
    _contact: str = ""
    _touched_s: float = -math.inf

    def __post_init__(self) -> None:
        self.playout = Playout(self._within(self.first), 0.0)

    # --- from the sender ------------------------------------------------------------------------

    def put(self, target: Target) -> None:
        """Add a target received since the last tick. One outside the joint limits is moved to the
        limit; one that is not finite is dropped."""
        numbers = (target.q, *([] if target.velocity is None else [target.velocity]))
        since_s = target.sent_s - self.first.sent_s
        if not (math.isfinite(since_s) and all(np.isfinite(x).all() for x in numbers)):
            self.refused += 1
            return
        if self.playout.put(self._within(target), self._now_s):
            self._heard_s = self._now_s
            self.bounded += int((np.abs(self.playout.speed) > FASTER * self.limits.velocity).any())

    def rejoin(self, *, interrupted: bool) -> None:
        """Move to the stream after a contact; interrupted: once the contact is over."""
        self._rejoins = interrupted
        if self.phase is Phase.WAITING:
            self.phase = Phase.JOINING

    def _within(self, target: Target) -> Target:
        """Target within the limits, its time counted from the first one: small times are exact."""
        limits, velocity = self.limits, target.velocity
        q = np.minimum(np.maximum(target.q, limits.lower), limits.upper)
        if velocity is not None:
            velocity = np.minimum(np.maximum(velocity, -limits.velocity), limits.velocity)
        fast = velocity is not None and (velocity != target.velocity).any()
        self.bounded += int(fast or (q != target.q).any())
        return Target(target.number, target.sent_s - self.first.sent_s, q, velocity)

    @property
    def moves(self) -> Reference:
        """Latest reference. Raises RuntimeError before `go_on`."""
        if self._tracker is None:
            raise RuntimeError("the stream has no pose to begin from")
        return Reference(self._tracker.q, self._tracker.velocity)

    # --- one tick -------------------------------------------------------------------------------

    @property
    def silent_s(self) -> float:
        """Time since the last accepted target [s]."""
        return self._now_s - self._heard_s

    @property
    def delay_s(self) -> float:
        """Delay of the arm behind the sender [s]: that of the playout, minus the tick in which a
        target waits, which counts as transmission."""
        return self.playout.delay_s - self._period_s

    @property
    def ended(self) -> bool:
        """True once the stream has been silent for more than ENDED_S."""
        return self.silent_s > ENDED_S

    @property
    def clock_in_words(self) -> str:
        """Jumps of the sender's clock; empty without any."""
        jumps = self.playout.jumps
        return f"; its time jumped forwards {jumps} times: `sent_s` is in seconds" if jumps else ""

    @property
    def contact(self) -> str:
        """Description of the present contact, or of one that ended less than SAID_S ago."""
        return self._contact if self._now_s - self._touched_s < SAID_S else ""

    def touch(self, contact: str) -> None:
        """Record the contact of this tick; empty without one."""
        if contact:
            self._contact, self._touched_s = contact, self._now_s

    def tick(self, dt: float) -> None:
        """Count dt [s]: in every tick, in each mode, from the start to the end of the stream."""
        self._now_s += dt
        self.playout.step(self._now_s, dt)

    def go_on(self, q: Vector, *, again: bool) -> None:
        """Begin at q (n,) [rad], at standstill; again: after a contact, or a halt."""
        self._tracker = Tracker(q.copy(), STREAM_SHARE * self.limits.acceleration)
        holds = self.settings.after_contact is AfterContact.HOLD and not self._rejoins
        waits, self._rejoins = again and holds, False
        self.phase = Phase.WAITING if waits else Phase.JOINING

    def reference(self, q: Vector, velocity: Vector, dt: float) -> Reference:
        """Reference dt [s] later, of an arm at q (n,) [rad] with setpoints `velocity` (n,) [rad/s].
        Raises RuntimeError before `go_on`."""
        tracker, self._period_s = self._tracker, dt
        if tracker is None:
            raise RuntimeError("the stream has no pose to begin from")
        target, speed = self.playout.read(LAG_S)
        apart = newest = float(np.abs(target - tracker.q).max())
        if self.phase is not Phase.FOLLOWING:
            newest = float(np.abs(self.playout.newest.q - tracker.q).max())
        silent, reach = self.silent_s > STALLED_S, self.settings.reach
        self.phase = next_phase(self.phase, silent=silent, apart=apart, newest=newest, reach=reach)
        braked, self._braked = self._braked, self.silent_s > BRAKED_S or self.phase in STANDING
        if self._braked:
            if not braked:
                tracker.velocity = velocity
            return tracker.brake(q, self.limits.acceleration, dt)
        most = self.limits.velocity
        if self.phase is Phase.JOINING:
            most = np.minimum(most, self.settings.join_velocity)
        return tracker.step(target, speed, most, dt)

    # --- as a JointPath -------------------------------------------------------------------------

    def continued_from(self, q: Vector) -> "TargetStream":
        """Itself: it continues from any pose."""
        del q
        return self

    def offset(self, s: float) -> Vector:
        """Zero: its course is not known in advance."""
        del s
        return np.zeros_like(self.limits.lower)

    slope = fastest = offset

    def extent(self, s: float) -> tuple[Vector, Vector]:
        """Zero, as `offset`."""
        return self.offset(s), self.offset(s)
