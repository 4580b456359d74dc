"""Controller: applies requests, findings, contacts and the arm's own events to the mode table, and
decides what the drives do.

No I/O and no clock: time is an argument, requests come in between two ticks, and the decision is
plain data. The motion in each mode is in `motion`, its bounds in `limits` and `admittance`.
"""

import numpy as np

from common.arrays import Vector
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding, strongest
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.machine import Change, ModeMachine, Trigger
from daemon.modes.quiet_timer import QuietTimer
from daemon.modes.release_stage import ReleaseStage
from daemon.modes.table import ARMABLE, GUIDED, YIELDING, Event, Mode, refusal
from daemon.motion.admittance import Allowance
from daemon.motion.hand_witness import HandWitness
from daemon.motion.motion import Motion
from daemon.motion.path import JointPath, PathPoint
from daemon.motion.target_stream import CAUSES, ENDED_S, Phase, TargetStream
from daemon.protocol.state import StreamState
from daemon.tick.contact_events import ContactEvents
from daemon.tick.decision import ControlInput, ControllerSettings, Decision
from daemon.tick.leading import Leading
from daemon.tick.own_events import OwnEvents
from daemon.tick.refusals import lacking, not_energisable, not_startable, path_collision, touched
from daemon.tick.telemetry import stream_state
from drivers.api import PowerTarget

# Time for a reset, after which a drive's fault counts as a new one [s].
RESET_TIMEOUT_S = 0.5


class Controller:
    """Modes, references and setpoints of one arm."""

    def __init__(
        self, tuning: ControllerSettings, motion: Motion, witness: HandWitness | None = None
    ) -> None:
        """witness: detects a hand that leads the arm; None: every push counts as one."""
        self.machine = ModeMachine()
        self.motion = motion
        self.leading = Leading(self.machine, motion, tuning.joints)
        self.quiet = QuietTimer(tuning.quiet_s)
        self._tuning, self._witness = tuning, witness
        self._configured = motion.follower.place
        self._allowance = Allowance(tuning.bounds, len(tuning.joints))
        self._contacts = ContactEvents(tuning.reactions, self.machine, motion, self.quiet)
        self._own = OwnEvents(tuning, self.machine, motion, self.quiet, self._allowance, witness)
        self._observed: ControlInput | None = None
        self._phase: Phase | None = None  # of the stream, as reported
        self._damped = ""  # axes of the guide, as reported
        self._stepped_s = 0.0  # time of the latest step
        self._finding: Finding | None = None  # the last one that changed the mode

    @property
    def finding(self) -> Finding | None:
        """Finding that led to the present mode; None if another event did."""
        found = self._finding
        return found if found and self.machine.cause == str(found) else None

    @property
    def pressed(self) -> str:
        """Contact still present after the arm stopped for it; empty without one."""
        return "" if self._observed is None else self._contacts.pressed(self._observed)

    @property
    def stream(self) -> TargetStream | None:
        """Stream that the arm follows, or follows again after a contact or a halt."""
        return self.motion.stream if self.machine.moving or self.machine.paused else None

    def stream_state(self) -> StreamState | None:
        """State of the stream; None without one."""
        stream = self.stream
        return None if stream is None else stream_state(stream, self.machine.trajectory)

    @property
    def faulted(self) -> bool:
        """True while a fault is latched."""
        return self.machine.mode is Mode.FAULTED

    # --- requests of a person, between two ticks --------------------------------------------

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

    def next_place(self, path: JointPath | None = None) -> PathPoint:
        """Point of the trajectory, or the one at which `start` would begin it."""
        if path is not None:
            return PathPoint(path)
        goes_on = self.machine.moving or self.machine.paused
        return self.motion.follower.place if goes_on else self._configured

    def arm(self, who: str) -> list[str]:
        """Allow contacts to move the arm, unless the mode forbids it; returns the reason. A new
        arming renews the allowance, a repeated one does not. All other conditions are checked
        before, by `daemon.arming`."""
        if self.machine.mode not in ARMABLE:
            return [refusal(self.machine.mode, "arm")]
        if not self.machine.armed:
            self._allowance.renew()
        self.machine.arm(f"armed by {who}")
        return []

    def disarm(self, cause: str, time_s: float) -> None:
        """Take the permission back: an arm that is being led stops and holds."""
        self._apply(Event.DISARM, cause, time_s)

    def apply_event(self, event: Event, cause: str, time_s: float) -> None:
        """Apply `stop`, `disarm` or a fault after a request that raised an error."""
        self._apply(event, cause, time_s)

    def refusals(self, event: Event, path: JointPath | None = None) -> list[str]:
        """Reasons why `request` would refuse; empty if it would not."""
        mode, observed, place = self.machine.mode, self._observed, self.next_place(path)
        if not self.machine.can(event):
            return [f"cannot {event.value}: {refusal(mode, event.value)}"]
        if event in (Event.ENABLE, Event.START, Event.RESET) and observed is None:
            return ["no samples of the drives yet"]
        if event is Event.START and (lacks := lacking(place.path, blind=self.motion.blind)):
            return lacks
        joints, limits, blind = self._tuning.joints, self.motion.limits, self.motion.blind
        if event is Event.START and observed is not None:
            reasons = touched(observed, place.path, armed=self.machine.armed, blind=blind)
            reasons = reasons or not_startable(joints, observed.q, limits, place)
            walls = None if reasons else self.motion.walls
            self.motion.meeting = met = path_collision(walls, observed.q, place)
            return [met.text] if met else reasons
        if event is Event.ENABLE and observed is not None:
            return not_energisable(joints, self._tuning.ends, limits, observed)
        return []

    # --- one tick ---------------------------------------------------------------------------

    def step(self, time_s: float, dt: float, observed: ControlInput) -> Decision:
        """Decision for the drives until the next tick; dt [s] since the last decision."""
        self._observed = observed
        self.doubt(time_s, observed.findings)
        self._follow(self._contacts.trigger(time_s, observed), time_s)
        self._follow(self._own.trigger(time_s, dt, observed), time_s)
        self._hear(time_s, observed.hit or observed.touched)
        motion, o, push = self.motion, observed, self._push(observed, dt)
        motion.step(self.machine.mode, o.q, o.age_s, push, dt, o.play, o.motor_velocity)
        self._report_changes()
        resetting = self._resetting(time_s)
        return Decision(self._power(), resetting, motion.velocity, motion.reference)

    def _hear(self, time_s: float, contact: str) -> None:
        """Count the time for a stream, all of it where a tick is late, and forget one that has
        ended."""
        elapsed_s, self._stepped_s = time_s - self._stepped_s, time_s
        if stream := self.stream:
            stream.tick(elapsed_s)
            stream.touch(contact)
            if stream.ended:
                cause = f"the stream of {stream.sender} fell silent for {ENDED_S:g} s"
                if self.machine.paused:  # silence is no reason to forget who paused it
                    cause = f"{self.machine.cause}; the stream of {stream.sender} has ended"
                self._apply(Event.ABANDON, cause + stream.clock_in_words, time_s)

    def _report_changes(self) -> None:
        """Report, with the modes, a change of the stream's phase, and a guide that gives way."""
        stream = self.stream
        phase, before = stream.phase if stream else None, self._phase
        if phase is not before and phase and before:
            self.machine.changes.append(Change(f"stream {phase}", CAUSES[phase]))
        damped = self.motion.guidance.damped if self.machine.mode is Mode.ADMITTANCE else ""
        if damped and damped != self._damped:
            cause = "a force withstood its spring for 1 s, as an obstacle would"
            self.machine.changes.append(Change(f"guide yields along {damped}", cause))
        self._phase, self._damped = phase, damped

    def _push(self, observed: ControlInput, dt: float) -> Vector:
        """Thresholded residual (n,) [Nm] that moves an arm that yields."""
        witness, independent = self._witness, observed.independent
        self.motion.excess, self.motion.guidance.led = None, True
        self.motion.guidance.sure, self.motion.guidance.residual = observed.sure, None
        if self.machine.mode is not Mode.ADMITTANCE or witness is None or independent is None:
            return observed.thresholded
        self.motion.guidance.residual = independent.agreed
        push = witness.step(independent, observed.motor_velocity, dt)
        self.motion.guidance.led = witness.leads
        self.motion.excess = witness.excess if self._tuning.assists and observed.sure else None
        return push

    def _backed_away(self, observed: ControlInput) -> Vector:
        """Thresholded residual (n,) [Nm] that the arm backs away from: that of joints on which a
        hand is witnessed. Where none is, it stands until one is, or until it is quiet."""
        witness, independent = self._witness, observed.independent
        if witness is None or independent is None:
            return observed.avoided
        hand = witness.witnessed(independent, observed.motor_velocity)
        return np.where(hand, observed.avoided, 0.0)

    def doubt(self, time_s: float, findings: tuple[Finding, ...]) -> None:
        """React to findings; also before the first complete samples."""
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
        if self.machine.mode is not Mode.OFF or self.machine.entered_by is not Event.RESET:
            return False
        return time_s < self.machine.entered_s + RESET_TIMEOUT_S

    def _way_back(self, q: Vector, home: Vector) -> Vector:
        """End of the way back to the trajectory (n,) [rad]: the pose at which a contact took the
        arm from it, or the pose nearest to q from which it fits. The latter lies between q and
        home, as it fits from home."""
        if self._own.after_quiet is AfterQuiet.RETURN:
            return home
        limits = self.motion.limits
        return self.motion.follower.place.nearest(q, limits.lower, limits.upper)

    def _follow(self, trigger: Trigger | None, time_s: float) -> None:
        if trigger is not None:
            self._apply(trigger.event, trigger.cause, time_s)

    def _apply(self, event: Event, cause: str, time_s: float) -> None:
        """Follow the table, and set up the initial state of the new mode."""
        before = self.machine.mode
        if not self.machine.apply(event, cause, time_s) or self._observed is None:
            return
        if self.machine.mode is not before:
            self._set_up(before, event, self._observed, time_s)
        elif event is Event.RETRACT:
            # From its reference: where it can get no further away, it stands stiff.
            self.motion.retract(self.motion.reference, self._backed_away(self._observed))

    def _set_up(self, before: Mode, event: Event, observed: ControlInput, time_s: float) -> None:
        motion, allowance, mode = self.motion, self._allowance, self.machine.mode
        if mode in YIELDING or mode is Mode.OFF:
            motion.meeting = None  # of a path from where the arm no longer stands
        if mode in YIELDING:
            if self._witness is not None:
                self._witness.begin()
            allowance.take(motion.reference)
            motion.yield_to(observed.thresholded, observed.motor_velocity)
        if mode in GUIDED:
            if self._own.after_quiet is AfterQuiet.HOLD and self.machine.moving:
                self.machine.moving, self.machine.paused = False, True
            self.quiet.restart(time_s)
        home = motion.reference if allowance.home is None else allowance.home
        if mode is Mode.RETRACTING:
            motion.retract(observed.q, self._backed_away(observed))
        elif mode is Mode.RELEASING:
            motion.release(observed.q, observed.avoided, observed.residual)
        elif mode is Mode.RETURNING:
            motion.go_back(observed.q, self._way_back(observed.q, home))
        elif mode is Mode.TRACKING:
            anchor = motion.reference if event is Event.ARRIVED else observed.q
            motion.follow(anchor, again=event is not Event.START)
        elif before is Mode.STOPPING and self._contacts.stage is ReleaseStage.CONTACT_ENDED:
            push = observed.pressing
            motion.hold(motion.release_motion.rest(observed.q, motion.reference, push))
        else:
            # At its end the arm stands where it was going.
            motion.hold(motion.reference if event is Event.END else observed.q)
        self._contacts.mode_changed(before, event)
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
