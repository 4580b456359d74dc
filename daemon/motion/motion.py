"""Motion in each mode: reference and target velocity. It does not decide modes or read a clock."""

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from common.arrays import Vector
from daemon.modes.table import SENSING, Mode
from daemon.motion.admittance import AdmittanceLaw, Assist, Gains
from daemon.motion.guidance import Guidance
from daemon.motion.limits import Limits
from daemon.motion.line import PLANNED_SHARE, Line
from daemon.motion.path import Follower
from daemon.motion.release import Release, ReleaseSettings
from daemon.motion.target_stream import TargetStream
from daemon.protocol.state import Meeting
from estimator.model import Model
from estimator.walls import Walls

# Distance from the line's end at which a joint has arrived [rad].
ARRIVED_RAD = 0.01


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """Configured speeds, distances and gain of motion."""

    position_gain: float  # [1/s]
    return_velocity: float  # [rad/s]
    retract_velocity: float  # [rad/s]
    retract_distance: float  # of the joint that goes furthest [rad]
    release: ReleaseSettings


class Motion:
    """References and setpoints of one arm; vectors of shape (n,)."""

    def __init__(
        self,
        manner: MotionSettings,
        limits: Limits,
        law: AdmittanceLaw,
        gains: Gains,
        follower: Follower,
        *,
        blind: bool = False,
        walls: Walls | None = None,
        model: Model | None = None,
    ) -> None:
        """blind: the signs of the links are unchecked, so the motors hold the arm, and no loop is
        closed over the links; walls and model (for a guide) are then not used, as the positions of
        the links may be wrong."""
        self.velocity = np.zeros_like(limits.lower)
        """Target velocity [rad/s]"""
        self.reference = np.zeros_like(limits.lower)
        """Desired q [rad]"""
        self.blind, self.walls = blind, None if blind else walls
        self.model = None if blind else model
        self.meeting: Meeting | None = None
        """First collision of shapes on the last checked path, if any"""
        self._held_back = False  # by a wall, and not caught up yet
        self.limits, self.gains, self.follower = limits, gains, follower
        self.probing = np.zeros_like(limits.lower)
        """Additional velocity [rad/s] of a yielding arm, from `probe`"""
        self._probed = self._yielding = self.probing
        self.excess: Vector | None = None
        """Residual [Nm] beyond what witnesses a hand, from `hand_witness`; None in doubt"""
        self.guidance = Guidance(self.model, law.velocity, manner.position_gain)
        self._assist = Assist(law.velocity)
        self._manner, self._law = manner, law
        self.release_motion = Release(manner.release, limits)
        self._loose = False  # retracts without a push: stands without a position loop
        self._go(self.reference, self.reference, 1.0)

    # --- begin a mode, from the measured pose q within the limits ------------------------------

    def hold(self, q: Vector) -> None:
        """Stay at q [rad]."""
        self.reference = np.minimum(np.maximum(q, self.limits.lower), self.limits.upper)

    def follow(self, anchor: Vector, *, again: bool = False) -> None:
        """Run the trajectory, at its present path time, from `anchor` [rad]; again: after a
        contact."""
        self.reference, self.meeting = anchor.copy(), None
        if stream := self.stream:
            stream.go_on(self.reference, again=again)
        else:
            self.follower.anchor(self.reference)

    @property
    def stream(self) -> TargetStream | None:
        """Trajectory, if it is a stream of targets; else None."""
        path = self.follower.place.path
        return path if isinstance(path, TargetStream) else None

    def retract(self, q: Vector, thresholded: Vector) -> None:
        """Retract from q [rad] in the direction of the thresholded residual [Nm]; if that is zero,
        stand where the drives bring the arm to rest."""
        pushed = self.gains.value * thresholded
        furthest = float(np.abs(pushed).max())
        self._loose = furthest == 0.0
        share = 0.0 if self._loose else self._manner.retract_distance / furthest
        self._go(q, q + share * pushed, self._manner.retract_velocity)

    def release(self, q: Vector, thresholded: Vector, residual: Vector) -> None:
        """Release a contact, from q [rad], in the direction of the thresholded residual [Nm]."""
        self.hold(q)
        self.release_motion.begin(q, thresholded, residual)

    def yield_to(self, thresholded: Vector, motor_velocity: Vector) -> None:
        """Remove setpoints against the thresholded residual [Nm], when the arm begins to yield.

        A setpoint that a blocked motor does not reach only presses, and its drive seems not to
        follow: it is reduced at once to `motor_velocity` [rad/s], where the ramp begins.
        """
        self.probing = self._probed = np.zeros_like(self.velocity)
        self._assist.stop()
        self.guidance.begin(self.reference)  # not at q, which the push may have displaced
        reached = np.minimum(
            np.maximum(motor_velocity, -np.abs(self.velocity)), np.abs(self.velocity)
        )
        reached *= motor_velocity * self.velocity > 0.0
        self.velocity = np.where(thresholded * self.velocity < 0.0, reached, self.velocity)

    def can_release(self, q: Vector, thresholded: Vector) -> bool:
        """True if the arm can release: links are trusted, and a pressed joint has room."""
        return not self.blind and self.release_motion.possible(q, thresholded)

    def go_back(self, q: Vector, home: Vector) -> None:
        """Go slowly from q to `home` [rad]."""
        self._go(q, home, self._manner.return_velocity)

    def _go(self, q: Vector, end: Vector, velocity: float) -> None:
        self.hold(q)
        limits = self.limits
        end = np.minimum(np.maximum(end, limits.lower), limits.upper)
        self._line = Line.between(
            self.reference,
            end,
            np.minimum(velocity, limits.velocity),
            PLANNED_SHARE * limits.acceleration,
        )
        self._line_s = 0.0

    # --- progress along the line ---------------------------------------------------------------

    @property
    def under_way(self) -> bool:
        """True while the line's reference still moves."""
        return self._line_s < self._line.duration_s

    @property
    def line_duration_s(self) -> float:
        """Duration of the latest line [s]."""
        return self._line.duration_s

    def arrived(self, q: Vector) -> bool:
        """True if the arm is at the line's end."""
        return not self.under_way and float(np.abs(q - self.reference).max()) < ARRIVED_RAD

    def opposed(self, thresholded: Vector) -> bool:
        """True if the thresholded residual (n,) [Nm] pushes against the line."""
        return self.under_way and float(self._line.displacement @ thresholded) < 0.0

    # --- one tick ------------------------------------------------------------------------------

    def step(
        self,
        mode: Mode,
        q: Vector,
        age_s: Vector | None,
        push: Vector,
        dt: float,
        play: Vector | float = 0.0,
        moved: Vector | None = None,
    ) -> None:
        """Set velocity and reference for the next dt [s].

        They follow from the thresholded residual `push` (n,) [Nm], from q (n,) [rad], which was
        measured age_s [s] ago (None: now), from the links' `play`, as in `Limits.bound_velocity`,
        and from the velocities `moved` (n,) [rad/s] of the motors (None: the setpoints).
        """
        self.gains.step(dt)
        if mode is not Mode.ADMITTANCE and mode is not Mode.HOLDING:
            self.guidance.forget()
        desired = self._desired(mode, q, push, dt, play, moved)
        # Joints with an old sample are assumed to have moved at their setpoints since.
        here = q if age_s is None else q + self.velocity * age_s
        if mode in SENSING:
            before = self.velocity
            self.velocity = self.limits.bound_velocity(here, desired, before, dt, play)
            if self.walls is not None:
                wanted, self.velocity = self.velocity, np.empty_like(desired)
                moved = before if moved is None else moved
                self.walls.bound(here, moved, wanted, self.limits.each(play), self.velocity)
                self._held_back = self._held_back or self.walls.slows
                if mode is Mode.HOLDING and self.walls.slows and self.walls.touch(self.reference):
                    self.hold(q)  # a pose that walls prevent is not to be reached later either
        else:
            self.velocity = desired
            if self.walls is not None:
                self.walls.forget()

    def _desired(
        self,
        mode: Mode,
        q: Vector,
        push: Vector,
        dt: float,
        play: Vector | float,
        moved: Vector | None,
    ) -> Vector:
        gain = self._manner.position_gain
        match mode:
            case Mode.OFF | Mode.ENABLING | Mode.STOPPING | Mode.FAULTED:
                return np.zeros_like(self.velocity)
            case Mode.HOLDING:
                return np.zeros_like(q) if self.blind else self._towards(self.reference, q)
            case Mode.ADMITTANCE:
                # Bounds reduce the probing velocity first: this is no push the other way.
                low, high = np.minimum(self._probed, 0.0), np.maximum(self._probed, 0.0)
                swung = np.minimum(np.maximum(self.velocity - self._yielding, low), high)
                before, self._probed = self.velocity - swung, self.probing
                gains, assist = self.gains.value, self._assist
                if self.excess is None:
                    assist.stop()
                else:
                    assist.step(gains, push, self.excess, dt)
                if self.guidance.guides:
                    self._yielding = self._guided(q, before, push, dt, play, moved)
                else:
                    law = self._law
                    self._yielding = law.velocity_after(before, gains, push, dt, assist.velocity)
                return self.limits.soft_stop(q, self._yielding + self.probing, gain, play)
            case Mode.RELEASING | Mode.RETRACTING if mode is Mode.RELEASING or self._loose:
                # Joints without contact are held by their drives alone: a loop might pull them
                # back.
                self.hold(q)
                return (
                    self.release_motion.velocity(q) if mode is Mode.RELEASING else np.zeros_like(q)
                )
            case Mode.TRACKING:
                stream = self.stream
                wanted = (
                    stream.reference(q, self.velocity, dt) if stream else self.follower.step(dt)
                )
                if self.follower.place.path.motors_only:
                    self.reference = q
                    return wanted.velocity
            case Mode.RETRACTING | Mode.RETURNING:
                self._line_s += dt
                wanted = self._line.at(self._line_s)
            case _:
                assert_never(mode)
        self.reference = wanted.q
        return wanted.velocity + self._towards(wanted.q, q, np.abs(wanted.velocity))

    def _guided(
        self, q: Vector, before: Vector, push: Vector, dt: float, play: Vector | float,
        moved: Vector | None,
    ) -> Vector:  # fmt: skip
        """Velocity (n,) [rad/s] by the guide, of an arm that was led at `before`."""
        limits, moved = self.limits, self.velocity if moved is None else moved
        room = np.array([q - limits.lower, limits.upper - q]) - limits.each(play)
        gain, share = self.gains.value, self._law.share(dt)
        asked, sent = gain * push + self._assist.velocity, self.velocity
        return self.guidance.step(q, moved, sent, before, asked, share, gain, room, push, dt)

    def _towards(self, reference: Vector, q: Vector, speed: Vector | float = 0.0) -> Vector:
        """Velocity (n,) [rad/s] of the position loop. An arm that walls held back catches up slowly
        when they open: at the `speed` of its path or at `return_velocity`, whichever is larger."""
        velocity: Vector = self._manner.position_gain * (reference - q)
        if self.walls is None or not self._held_back:
            return velocity
        most = np.maximum(speed, self._manner.return_velocity)
        slowly = np.minimum(np.maximum(velocity, -most), most)
        self._held_back = self.walls.slows or bool((slowly != velocity).any())
        return slowly
