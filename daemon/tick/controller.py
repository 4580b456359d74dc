"""Controller: from requests and observations to events of the mode table, and to setpoints.

No I/O and no clock: time is an argument, requests come in between two ticks, and the decision is
plain data. How the arm moves in a mode is elsewhere (motion), and so is what is too far or too fast
(limits, admittance).
"""

from dataclasses import dataclass

import numpy as np

from arrays import Vector
from daemon.faults.finding import Finding, strongest
from daemon.faults.plausibility import STANDSTILL_SPEED
from daemon.faults.table import Condition, Response
from daemon.modes.contact_reactions import ATTENTIVE, AfterQuiet, Reactions
from daemon.modes.quiet_timer import QuietTimer
from daemon.modes.table import (
    ARMABLE,
    GUIDED,
    SENSING,
    YIELDING,
    Change,
    Event,
    Mode,
    ModeMachine,
    refusal,
)
from daemon.motion.admittance import MAX_GAIN, Allowance, AllowanceSettings
from daemon.motion.limits import all_finite
from daemon.motion.motion import Motion
from daemon.motion.path import JointPath, Place
from daemon.motion.release import Ending
from daemon.tick.refusals import lacking, leaves_limits, not_energisable, not_startable
from drivers.cia402 import PowerTarget, in_words

# How long a reset may take until a drive's fault counts as a new one [s].
RESET_PATIENCE_S = 0.5


@dataclass(frozen=True, slots=True)
class ControlInput:
    """Everything a decision is made of. Vectors of shape (n,), SI at the link."""

    q: Vector  # measured link position
    motor_velocity: Vector
    residual: Vector  # [Nm]
    thresholded: Vector  # thresholded residual [Nm]
    touched: str  # the contact that lasts, in words; empty without one
    hit: str  # the collision that lasts, likewise
    operating: tuple[bool, ...]  # which drives are in operation enabled
    statuswords: tuple[int, ...]
    findings: tuple[Finding, ...]
    age_s: Vector | None = None  # of q; None where every sample came in time
    recent: bool = True  # every sample came in this tick, or just before
    struck: bool = False  # a collision began in this tick
    sure: bool = True  # every joint senses, and what is felt did not just begin anew
    load: str = ""  # the load at the hand that explains all that is felt, in words
    play: Vector | float = 0.0  # how far links may fall down and up in their gaps, (2, n) [rad]


@dataclass(frozen=True, slots=True)
class Decision:
    """Commands to the drives, and the reference behind them; vectors of shape (n,)."""

    power: tuple[PowerTarget, ...]
    reset: bool  # ask drives in fault for a reset
    velocity: Vector  # target velocity [rad/s]
    reference: Vector  # desired q [rad]


@dataclass(frozen=True, slots=True)
class ControllerSettings:
    """Settings of the controller, from the configuration."""

    joints: tuple[str, ...]
    ends: tuple[str, ...]  # hold, brake or limp, per joint
    reactions: Reactions
    quiet_s: float
    after_quiet: AfterQuiet
    bounds: AllowanceSettings
    enable_timeout_s: float
    stop_timeout_s: float


class Controller:
    """Modes, references and setpoints of one arm."""

    def __init__(self, tuning: ControllerSettings, motion: Motion) -> None:
        self.machine = ModeMachine()
        self.motion = motion
        self.quiet = QuietTimer(tuning.quiet_s)
        self._tuning = tuning
        self._configured = motion.follower.place
        self._allowance = Allowance(tuning.bounds, len(tuning.joints))
        self._reset_until_s = -1.0
        self._observed: ControlInput | None = None
        self._released = False  # as far as it may be, from a contact that still lasts
        self._unfinished = False  # a release of it, which only ended for a doubt
        self._let_go = False  # of a contact, and now it stops
        self._finding: Finding | None = None  # the last one that changed the mode

    @property
    def finding(self) -> Finding | None:
        """Finding that led to the present mode; None where something else did."""
        found = self._finding
        return found if found and self.machine.cause == str(found) else None

    @property
    def pressed(self) -> str:
        """What presses on the arm that stopped for it, in words: a collision that lasts, or what a
        release left. Empty where nothing does."""
        observed = self._observed
        stands = self.machine.mode in (Mode.HOLDING, Mode.STOPPING)
        if observed is None or not stands or self.motion.blind:
            return ""
        left = self._released or self._unfinished
        return observed.hit or (observed.touched if left else "")

    @property
    def faulted(self) -> bool:
        """True while a fault is latched."""
        return self.machine.mode is Mode.FAULTED

    # --- what a person asks for, between two ticks ------------------------------------------

    def request(
        self, event: Event, who: str, time_s: float, path: JointPath | None = None
    ) -> list[str]:
        """Carry out a command; returns the reasons of a refusal, empty when it was done.

        `start` runs `path`; without one it goes on with what was paused, else it runs the
        configured trajectory from its beginning.
        """
        place = self.next_place(path)
        if reasons := self.refusals(event, path):
            return reasons
        what = ""
        if event is Event.START:
            self.motion.follower.place = place
            what = f" of {place.path.name}" + (f" at {place.s:.1f} s" if place.s else "")
        self._apply(event, f"{event.value}{what} by {who}", time_s)
        return []

    def next_place(self, path: JointPath | None = None) -> Place:
        """Place of the trajectory, or the one at which `start` would begin it."""
        if path is not None:
            return Place(path)
        goes_on = self.machine.moving or self.machine.paused
        return self.motion.follower.place if goes_on else self._configured

    def arm(self, who: str) -> list[str]:
        """Allow contacts to move the arm, unless the mode forbids it; returns why. A new arming
        renews what contacts may do, a repeated one does not. All else is for `ArmingChecks`, which
        are run before."""
        mode = self.machine.mode
        if mode not in ARMABLE:
            return [refusal(mode, "arm")]
        if not self.machine.armed:
            self._allowance.renew()
        self.machine.arm(f"armed by {who}")
        return []

    def disarm(self, cause: str, time_s: float) -> None:
        """Take the permission back: an arm that is being guided stops and holds."""
        self._apply(Event.DISARM, cause, time_s)

    def set_gain(self, joint: str, gain: float, who: str) -> list[str]:
        """Let K_a [rad/s per Nm] of a joint move to `gain`, in any mode; returns why not."""
        if joint not in self._tuning.joints:
            return [f"no joint {joint!r}; there are: {', '.join(self._tuning.joints)}"]
        if not 0.0 <= gain <= MAX_GAIN:
            return [f"{gain:g} is not a gain: 0 to {MAX_GAIN:g} rad/s per Nm"]
        i = self._tuning.joints.index(joint)
        text = f"gain of {joint} {self.motion.gains.goal[i]:g} -> {gain:g} rad/s per Nm"
        self.machine.changes.append(Change(text, f"by {who}"))
        self.motion.gains.change(i, gain)
        return []

    def refusals(self, event: Event, path: JointPath | None = None) -> list[str]:
        """Reasons why `request` would refuse; empty if it would not."""
        mode, observed, place = self.machine.mode, self._observed, self.next_place(path)
        if not self.machine.can(event):
            return [f"cannot {event.value}: {refusal(mode, event.value)}"]
        if event in (Event.ENABLE, Event.START, Event.RESET) and observed is None:
            return ["no samples of the drives yet"]
        if event is Event.START and (lacks := lacking(place.path, blind=self.motion.blind)):
            return lacks
        joints, limits = self._tuning.joints, self.motion.limits
        if event is Event.START and observed is not None:
            pressed = self._pressed(observed) or self._carried(observed)
            touched = self._touched(observed) if place.path.halts_at_contact else []
            return pressed or touched or not_startable(joints, observed.q, limits, place)
        if event is Event.ENABLE and observed is not None:
            return not_energisable(joints, self._tuning.ends, limits, observed)
        return []

    def _pressed(self, observed: ControlInput) -> list[str]:
        """Reason against `start`: a collision that lasts. Links that are not trusted show none."""
        return [f"{observed.hit}: free it first"] if observed.hit and not self.motion.blind else []

    def _touched(self, observed: ControlInput) -> list[str]:
        """Reason against `start` of a path on which the arm would halt at once."""
        return [f"{observed.touched}: free it first"] if observed.touched else []

    def _carried(self, observed: ControlInput) -> list[str]:
        """Reason against `start`: a load that the model does not count, at which an arm that is
        armed would halt at once."""
        if not (self.machine.armed and observed.touched and observed.load):
            return []
        return [f"{observed.touched}: {observed.load}, tell it first (`contactctl payload`)"]

    # --- one tick ---------------------------------------------------------------------------

    def step(self, time_s: float, dt: float, observed: ControlInput) -> Decision:
        """Decide what the drives do until the next tick; dt [s] since the last decision."""
        self._observed = observed
        self.doubt(time_s, observed.findings)
        if self.machine.mode in SENSING:
            self._feel(time_s, observed)
        self._progress(time_s, dt, observed)
        motion = self.motion
        mode, push = self.machine.mode, observed.thresholded
        motion.step(mode, observed.q, observed.age_s, push, dt, observed.play)
        resetting = self._resetting(time_s)
        return Decision(self._power(), resetting, motion.velocity, motion.reference)

    def doubt(self, time_s: float, findings: tuple[Finding, ...]) -> None:
        """React to findings; also before there is anything to decide on."""
        if not findings:
            return
        if self._resetting(time_s):
            findings = tuple(f for f in findings if f.condition is not Condition.DRIVE_FAULT)
        finding = strongest(findings)
        if finding and (event := finding.response.event):
            self._apply(event, str(finding), time_s)
            if self.machine.cause == str(finding):
                self._finding = finding

    def _resetting(self, time_s: float) -> bool:
        """True while drives are asked for a fault reset: only while nothing may move yet."""
        return self.machine.mode is Mode.OFF and time_s < self._reset_until_s

    def _feel(self, time_s: float, observed: ControlInput) -> None:
        touched = any(observed.thresholded.tolist())
        self.quiet.sense(touched, time_s, sure=observed.sure)
        mode, armed, reactions = self.machine.mode, self.machine.armed, self._tuning.reactions
        retracting = mode is Mode.RETRACTING and self.motion.under_way
        backed_away = mode is Mode.RETRACTING and not retracting
        attentive = mode in ATTENTIVE or backed_away
        if attentive and not observed.touched and observed.sure:
            self._released = self._unfinished = False
            self.motion.giving_way.forget()
        counts = observed.struck or (attentive and not self.motion.blind)
        # What was not let go of for a doubt still is a collision, down to the contact level.
        hit = observed.hit or (observed.touched if self._unfinished else "")
        reaction = reactions.to_contact(armed) or self._halt_of_path()
        if hit and counts and (event := self._able(reactions.to_collision(armed))):
            if not (retracting and event in (Event.RETRACT, Event.RELEASE)):
                self._apply(event, hit, time_s)
        elif observed.touched and observed.load:
            self._carry(reaction, observed, time_s)
        elif observed.touched and attentive and (event := self._able(reaction)):
            self._apply(event, observed.touched, time_s)

    def _halt_of_path(self) -> Event | None:
        """Event of a contact to which the configuration and the permission know no reaction."""
        careful = self.motion.follower.place.path.halts_at_contact
        return Event.HALT if self.machine.mode is Mode.TRACKING and careful else None

    def _carry(self, reaction: Event | None, observed: ControlInput, time_s: float) -> None:
        """Hold what looks like a load instead of being led by it, or backing away from it. While
        the arm holds, nothing happens; other reactions are as for any contact."""
        if reaction in (Event.TOUCH, Event.RETRACT):
            reaction = Event.HALT
        carries = self.machine.mode in ATTENTIVE or self.machine.mode in GUIDED
        if carries and (event := self._able(reaction)):
            self._apply(event, f"{observed.touched}: {observed.load}", time_s)

    def _able(self, event: Event | None) -> Event | None:
        """Event of a contact as far as the arm can follow it: where it must not let go it halts,
        and where it holds it has halted."""
        mode, observed = self.machine.mode, self._observed
        if event is Event.RELEASE and self.machine.can(event) and observed is not None:
            sure = observed.sure and all(f.response is Response.CONTINUE for f in observed.findings)
            possible = self.motion.can_release(observed.q, observed.thresholded)
            # Once from each contact: between two obstacles the arm does not go to and fro. Again
            # where it only ended for a doubt.
            if self._released or not (sure and possible):
                event = Event.HALT
        return None if event is Event.HALT and mode is Mode.HOLDING else event

    def _progress(self, time_s: float, dt: float, observed: ControlInput) -> None:
        """Apply the arm's own events: energised, at rest, quiet, at a bound, arrived, too late."""
        mode, elapsed = self.machine.mode, time_s - self.machine.entered_s
        if mode is Mode.ADMITTANCE or mode is Mode.RETRACTING:
            self._allowance.spend(dt)
            self._progress_yielding(time_s, observed)
            return
        self._allowance.recover(dt)
        if mode is Mode.RELEASING:
            self._progress_releasing(time_s, dt, observed)
        elif mode is Mode.ENABLING:
            if all(observed.operating):
                self._apply(Event.ENERGISED, "drives enabled", time_s)
            elif elapsed > self._tuning.enable_timeout_s:
                text = f"the drives were not enabled within {self._tuning.enable_timeout_s:g} s"
                self._apply(Event.TIMEOUT, f"{text}: {self._not_enabled(observed)}", time_s)
        elif mode is Mode.STOPPING:
            still = np.abs(observed.motor_velocity) < STANDSTILL_SPEED
            if observed.recent and still.all() and not self.motion.velocity.any():
                self._apply(Event.STANDSTILL, self.machine.cause, time_s)
            elif elapsed > self._tuning.stop_timeout_s:
                text = f"the arm did not stop within {self._tuning.stop_timeout_s:g} s"
                self._apply(Event.TIMEOUT, text, time_s)
        elif mode is Mode.TRACKING and self.motion.follower.finished:
            text = f"{self.motion.follower.place.path.name} came to its end"
            self._apply(Event.END, text, time_s)
        elif mode is Mode.RETURNING:
            if self.motion.arrived(observed.q):
                self._apply(Event.ARRIVED, "back where the trajectory goes on", time_s)
            elif elapsed > self.motion.line_duration_s + self._tuning.stop_timeout_s:
                text = f"the arm did not get back to its trajectory within {elapsed:.1f} s"
                self._apply(Event.TIMEOUT, text, time_s)

    def _not_enabled(self, observed: ControlInput) -> str:
        drives = zip(self._tuning.joints, observed.operating, observed.statuswords, strict=True)
        return ", ".join(f"{name} is in {in_words(word)}" for name, on, word in drives if not on)

    def _progress_releasing(self, time_s: float, dt: float, observed: ControlInput) -> None:
        release = self.motion.giving_way
        q, felt = observed.q, observed.thresholded
        release.step(q, observed.motor_velocity, felt, dt, sure=observed.sure)
        if release.end:
            event = Event.BOUND if release.end in (Ending.BOUND, Ending.TIME) else Event.HALT
            words = release.in_words(self._tuning.joints, q, felt, observed.residual)
            self._apply(event, words, time_s)

    def _progress_yielding(self, time_s: float, observed: ControlInput) -> None:
        if bound := self._allowance.bound_reached(observed.q):
            self._apply(Event.BOUND, bound, time_s)
        elif self.machine.mode is Mode.RETRACTING and self.motion.under_way:
            if self.motion.opposed(observed.thresholded):
                self._apply(Event.HALT, "pushed against while retracting", time_s)
        elif self.quiet.expired:
            event, reasons = self._after_quiet(observed.q)
            self._apply(
                event, "; ".join([f"quiet for {self.quiet.quiet_s:.2f} s", *reasons]), time_s
            )

    def _after_quiet(self, q: Vector) -> tuple[Event, list[str]]:
        if not self.machine.moving:
            return Event.SETTLE, []
        if self._tuning.after_quiet is AfterQuiet.RETURN:
            return Event.RETURN, []
        place, limits = self.motion.follower.place, self.motion.limits
        reasons = leaves_limits(self._tuning.joints, q, limits, place)
        if not reasons:
            return Event.RESUME, []
        fits = all_finite(place.nearest(q, limits.lower, limits.upper))
        return (Event.RETURN if fits else Event.SETTLE), reasons

    def _way_back(self, q: Vector, home: Vector) -> Vector:
        """End of the way back to the trajectory (n,) [rad]: where a contact took the arm from it,
        or the pose nearest to q from which it fits. That lies between q and home, as it fits from
        home."""
        if self._tuning.after_quiet is AfterQuiet.RETURN:
            return home
        limits = self.motion.limits
        return self.motion.follower.place.nearest(q, limits.lower, limits.upper)

    def _apply(self, event: Event, cause: str, time_s: float) -> None:
        """Follow the table, and set up what the new mode starts from."""
        before = self.machine.mode
        if not self.machine.apply(event, cause, time_s) or self._observed is None:
            return
        if event is Event.RESET:
            self._reset_until_s = time_s + RESET_PATIENCE_S
        if self.machine.mode is not before:
            self._set_up(before, event, self._observed, time_s)
        elif event is Event.RETRACT:
            # From its reference: where it can get no further away, it stands stiff.
            self.motion.retract(self.motion.reference, self._observed.thresholded)

    def _set_up(self, before: Mode, event: Event, observed: ControlInput, time_s: float) -> None:
        motion, allowance, mode = self.motion, self._allowance, self.machine.mode
        if mode in YIELDING:
            allowance.take(motion.reference)
            motion.yield_to(observed.thresholded, observed.motor_velocity)
        if mode in GUIDED:
            if self._tuning.after_quiet is AfterQuiet.HOLD and self.machine.moving:
                self.machine.moving, self.machine.paused = False, True
            self.quiet.restart(time_s)
        home = motion.reference if allowance.home is None else allowance.home
        if mode is Mode.RETRACTING:
            motion.retract(observed.q, observed.thresholded)
        elif mode is Mode.RELEASING:
            motion.release(observed.q, observed.thresholded, observed.residual)
        elif mode is Mode.RETURNING:
            motion.go_back(observed.q, self._way_back(observed.q, home))
        elif mode is Mode.TRACKING:
            motion.follow(motion.reference if event is Event.ARRIVED else observed.q)
        elif before is Mode.STOPPING and self._let_go:
            push = observed.thresholded
            motion.hold(motion.giving_way.rest(observed.q, motion.reference, push))
        else:
            # At its end the arm stands where it was going.
            motion.hold(motion.reference if event is Event.END else observed.q)
        if before is Mode.RELEASING:
            unsure = event is Event.HALT and motion.giving_way.end is Ending.UNSURE
            self._unfinished = unsure or event is Event.DOUBT
            self._released = not self._unfinished
        let_go = event is Event.HALT and motion.giving_way.end is Ending.LET_GO
        self._let_go = before is Mode.RELEASING and let_go
        if mode not in GUIDED and mode not in (Mode.RELEASING, Mode.STOPPING):
            allowance.leave(motion.reference)

    def _power(self) -> tuple[PowerTarget, ...]:
        match self.machine.mode:
            case Mode.OFF:
                # A joint that must not fall stays in quick stop, where its drive holds it.
                return tuple(
                    PowerTarget.QUICK_STOP if end == "hold" else PowerTarget.OFF
                    for end in self._tuning.ends
                )
            case Mode.FAULTED:
                return (PowerTarget.QUICK_STOP,) * len(self._tuning.joints)
            case _:
                return (PowerTarget.ON,) * len(self._tuning.joints)
