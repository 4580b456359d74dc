"""Events of the arm itself: energised, at rest, quiet, at a bound, arrived, timeout. Each mode has
a function from the inputs of a tick to an event of the mode table."""

from collections.abc import Callable, Iterator
from itertools import islice

import numpy as np

from common.arrays import Vector
from daemon.faults.plausibility import STANDSTILL_SPEED
from daemon.modes.contact_reactions import AfterQuiet
from daemon.modes.machine import Change, ModeMachine, Trigger
from daemon.modes.quiet_timer import QuietTimer
from daemon.modes.release_stage import Ending
from daemon.modes.table import Event, Mode
from daemon.motion.admittance import Allowance
from daemon.motion.hand_witness import HandWitness
from daemon.motion.limits import all_finite
from daemon.motion.motion import Motion
from daemon.motion.probe import Probe
from daemon.protocol.state import Meeting
from daemon.tick.decision import ControlInput, ControllerSettings
from daemon.tick.refusals import leaves_limits, path_collisions

# Points of the path that are checked in one tick, before it resumes: half a millisecond.
PLACES_A_TICK = 8


class OwnEvents:
    """Events of one arm that neither a person nor a contact causes."""

    def __init__(
        self,
        settings: ControllerSettings,
        machine: ModeMachine,
        motion: Motion,
        quiet: QuietTimer,
        allowance: Allowance,
        witness: HandWitness | None = None,
    ) -> None:
        self._settings, self._machine, self._motion = settings, machine, motion
        self._quiet, self._allowance = quiet, allowance
        self._probe, self._witness = Probe(len(settings.joints), settings.quiet_s), witness
        self._ahead: Iterator[Meeting | None] | None = None  # points that are still to be checked
        self._rests = ""  # joint on which a hand was found to rest, since the arm began to yield
        self._handlers: dict[Mode, Callable[[float, ControlInput], Trigger | None]] = {
            Mode.ENABLING: self._enabling,
            Mode.STOPPING: self._stopping,
            Mode.TRACKING: self._tracking,
            Mode.RETURNING: self._returning,
        }

    def trigger(self, time_s: float, dt: float, observed: ControlInput) -> Trigger | None:
        """Event of one tick, dt [s] after the last; None without one."""
        mode = self._machine.mode
        if mode in (Mode.ADMITTANCE, Mode.RETRACTING):
            self._allowance.spend(dt)
            self._probe_for_hand(time_s, mode, observed)
            return self._yielding(mode, observed)
        self._allowance.recover(dt)
        self._rests = ""
        self._ahead = self._ahead if mode is Mode.RETURNING else None
        self._probe.forget()
        if mode is Mode.TRACKING and self._settings.probes and not observed.touched:
            self._probe.work(observed.residual, observed.motor_velocity, dt)
        if mode is Mode.RELEASING:
            return self._releasing(dt, observed)
        handler = self._handlers.get(mode)
        return handler(time_s - self._machine.entered_s, observed) if handler else None

    def _probe_for_hand(self, time_s: float, mode: Mode, observed: ControlInput) -> None:
        """Probe before a trajectory resumes after a hand was witnessed; if one rests on the arm,
        the quiet time restarts."""
        probe, machine, independent = self._probe, self._machine, observed.independent
        led = mode is Mode.ADMITTANCE and self._witness is not None and self._witness.hand
        if independent is None or not (led and machine.moving and self._settings.probes):
            probe.stop()
            self._motion.probing = probe.velocity
            return
        if observed.sure:
            probe.step(self._quiet.quiet_s, observed.residual, independent.threshold)
        else:
            probe.pause()
        self._motion.probing = probe.velocity
        model = self._motion.model
        jacobian = model.tool_jacobian(observed.q) if self._quiet.expired and model else None
        if self._quiet.expired and (joint := probe.hand(jacobian)) is not None:
            name = self._settings.joints[joint]
            if name != self._rests:
                cause = "the trajectory resumes once nothing presses, or push to lead the arm"
                machine.changes.append(Change(f"something rests on {name}", cause))
            self._rests = name
            self._quiet.restart(time_s)

    def _yielding(self, mode: Mode, observed: ControlInput) -> Trigger | None:
        if bound := self._allowance.bound_reached(observed.q):
            return Trigger(Event.BOUND, bound)
        if mode is Mode.RETRACTING and self._motion.under_way:
            opposed = self._motion.opposed(observed.opposing)
            return Trigger(Event.HALT, "pushed against while retracting") if opposed else None
        if not self._quiet.expired:
            self._ahead = None
            return None
        event, reasons = self._when_quiet(observed)
        if event is Event.RESUME:
            if (blocked := self._blocked(observed.q)) is None:
                return None
            event, reasons = (Event.SETTLE if blocked else event), blocked
        return Trigger(event, "; ".join([f"quiet for {self._quiet.quiet_s:.2f} s", *reasons]))

    @property
    def after_quiet(self) -> AfterQuiet:
        """Continuation of the trajectory after a contact; a stream has its own settings for the
        return to it."""
        return AfterQuiet.RESUME if self._motion.stream else self._settings.after_quiet

    def _when_quiet(self, observed: ControlInput) -> tuple[Event, list[str]]:
        """Event after the quiet time, with the reasons why the trajectory does not resume here."""
        if not self._machine.moving:
            return Event.SETTLE, []
        if observed.too_often:
            return Event.SETTLE, [observed.too_often]
        if self.after_quiet is AfterQuiet.RETURN:
            return Event.RETURN, []
        q, place, limits = observed.q, self._motion.follower.place, self._motion.limits
        reasons = leaves_limits(self._settings.joints, q, limits, place)
        if not reasons:
            return Event.RESUME, []
        fits = all_finite(place.nearest(q, limits.lower, limits.upper))
        return (Event.RETURN if fits else Event.SETTLE), reasons

    def _blocked(self, q: Vector) -> list[str] | None:
        """Reasons why the trajectory cannot resume from q (n,) [rad]: shapes that it would lead
        through each other. None until the check is complete, in a later tick."""
        if self._ahead is None:
            self._ahead = path_collisions(self._motion.walls, q, self._motion.follower.place)
        looks = list(islice(self._ahead, PLACES_A_TICK))
        met = next(filter(None, looks), None)
        if len(looks) == PLACES_A_TICK and met is None:
            return None
        self._ahead, self._motion.meeting = None, met
        return [met.text] if met else []

    def _releasing(self, dt: float, observed: ControlInput) -> Trigger | None:
        release = self._motion.release_motion
        q, push = observed.q, observed.pressing
        release.step(q, observed.motor_velocity, push, dt, sure=observed.sure)
        if not release.end:
            return None
        event = Event.BOUND if release.end in (Ending.BOUND, Ending.TIME) else Event.HALT
        return Trigger(event, release.in_words(self._settings.joints, q, push, observed.residual))

    def _enabling(self, elapsed_s: float, observed: ControlInput) -> Trigger | None:
        operating = observed.operating
        if all(operating):
            return Trigger(Event.ENERGISED, "drives enabled")
        if elapsed_s <= (timeout_s := self._settings.enable_timeout_s):
            return None
        drives = zip(self._settings.joints, operating, observed.drives, strict=True)
        late = ", ".join(f"{name} is in {drive.detail}" for name, on, drive in drives if not on)
        text = f"the drives were not enabled within {timeout_s:g} s: {late}"
        return Trigger(Event.TIMEOUT, text)

    def _stopping(self, elapsed_s: float, observed: ControlInput) -> Trigger | None:
        still = np.abs(observed.motor_velocity) < STANDSTILL_SPEED
        if observed.recent and still.all() and not self._motion.velocity.any():
            return Trigger(Event.STANDSTILL, self._machine.cause)
        if elapsed_s <= (timeout_s := self._settings.stop_timeout_s):
            return None
        return Trigger(Event.TIMEOUT, f"the arm did not stop within {timeout_s:g} s")

    def _tracking(self, _elapsed_s: float, _observed: ControlInput) -> Trigger | None:
        if not self._motion.follower.finished:
            return None
        return Trigger(Event.END, f"{self._motion.follower.place.path.name} came to its end")

    def _returning(self, elapsed_s: float, observed: ControlInput) -> Trigger | None:
        if self._motion.arrived(observed.q):
            # The trajectory then resumes from the reference.
            if (blocked := self._blocked(self._motion.reference)) is None:
                return None
            if blocked:
                return Trigger(Event.HALT, blocked[0])
            return Trigger(Event.ARRIVED, "back where the trajectory goes on")
        self._ahead = None
        if elapsed_s <= self._motion.line_duration_s + self._settings.stop_timeout_s:
            return None
        text = f"the arm did not get back to its trajectory within {elapsed_s:.1f} s"
        return Trigger(Event.TIMEOUT, text)
