"""Events of contacts and collisions: from the inputs of a tick to an event of the mode table, by
the configured reactions, as far as the arm can carry them out."""

from daemon.faults.conditions import Response
from daemon.modes.contact_reactions import ATTENTIVE, Reactions
from daemon.modes.machine import ModeMachine, Trigger
from daemon.modes.quiet_timer import QuietTimer
from daemon.modes.release_stage import LEFT, ReleaseStage, after_change, after_release
from daemon.modes.table import GUIDED, SENSING, Event, Mode
from daemon.motion.motion import Motion
from daemon.tick.decision import ControlInput


class ContactEvents:
    """Reactions of one arm to contact, and the stage of the present contact's release."""

    def __init__(
        self, reactions: Reactions, machine: ModeMachine, motion: Motion, quiet: QuietTimer
    ) -> None:
        self._reactions, self._machine = reactions, machine
        self._motion, self._quiet = motion, quiet
        self.stage = ReleaseStage.NONE
        self._opposed = False

    def pressed(self, observed: ControlInput) -> str:
        """Description of a contact that is still present after the arm stopped for it: a collision,
        or what remains after a release; empty without one."""
        if self._machine.mode not in (Mode.HOLDING, Mode.STOPPING) or self._motion.blind:
            return ""
        return observed.hit or (observed.touched if self.stage in LEFT else "")

    def mode_changed(self, before: Mode, event: Event) -> None:
        """Process a change of the mode that `event` caused."""
        released = before is Mode.RELEASING
        end = self._motion.release_motion.end
        self.stage = after_release(event, end) if released else after_change(self.stage)
        opposed = before is Mode.RETRACTING and event is Event.HALT and self._motion.under_way
        self._opposed |= opposed

    def trigger(self, time_s: float, observed: ControlInput) -> Trigger | None:
        """Event of the contacts of one tick; None without one, or without a reaction to it."""
        if (mode := self._machine.mode) not in SENSING:
            return None
        touched = any(observed.thresholded.tolist())
        self._quiet.sense(touched, time_s, sure=observed.sure)
        self._opposed &= not self._quiet.expired
        retracting = mode is Mode.RETRACTING and self._motion.under_way
        attentive = mode in ATTENTIVE or (mode is Mode.RETRACTING and not retracting)
        if attentive and not observed.touched and observed.sure:
            self.stage = ReleaseStage.NONE
            self._motion.release_motion.forget()
        if event := self._of_collision(observed, attentive):
            goes_on = retracting and event in (Event.RETRACT, Event.RELEASE)
            return None if goes_on else Trigger(event, self._collision(observed))
        return self._of_contact(observed, attentive) if observed.touched else None

    def _collision(self, observed: ControlInput) -> str:
        """Description of the contact that counts as a collision; empty without one."""
        unfinished = self.stage is ReleaseStage.UNFINISHED
        return observed.hit or (observed.touched if unfinished else "")

    def _of_collision(self, observed: ControlInput, attentive: bool) -> Event | None:
        counts = observed.struck or (attentive and not self._motion.blind)
        if not (counts and self._collision(observed)):
            return None
        return self._permitted(self._reactions.to_collision(self._machine.armed), observed)

    def _of_contact(self, observed: ControlInput, attentive: bool) -> Trigger | None:
        """Event of a contact below the collision level. For a probable load the arm halts instead
        of yielding or retracting; while it holds, a load causes no event."""
        reaction = self._reactions.to_contact(self._machine.armed) or self._halt_of_path()
        cause = observed.touched
        if observed.load:
            attentive = self._machine.mode in ATTENTIVE or self._machine.mode in GUIDED
            reaction = Event.HALT if reaction in (Event.TOUCH, Event.RETRACT) else reaction
            cause = f"{observed.touched}: {observed.load}"
        event = self._permitted(reaction, observed) if attentive else None
        return Trigger(event, cause) if event else None

    def _halt_of_path(self) -> Event | None:
        """Event of a contact to which configuration and permission assign no reaction."""
        careful = self._motion.follower.place.path.halts_at_contact
        return Event.HALT if self._machine.mode is Mode.TRACKING and careful else None

    def _permitted(self, event: Event | None, observed: ControlInput) -> Event | None:
        """Event of a contact as far as the arm can carry it out: a halt if it must not release, and
        none if it holds already."""
        if event is Event.RELEASE and self._machine.can(event):
            event = event if self._releases(observed) else Event.HALT
        elif event is Event.RETRACT and (self._opposed or not observed.avoided.any()):
            # An arm that waits after retracting keeps waiting.
            event = None if self._machine.mode is Mode.RETRACTING else Event.HALT
        return None if event is Event.HALT and self._machine.mode is Mode.HOLDING else event

    def _releases(self, observed: ControlInput) -> bool:
        """True if the arm may release: once for each contact, so that it does not move to and fro
        between two obstacles; again if a release only ended because sensing was not reliable."""
        if self.stage in (ReleaseStage.RELEASED, ReleaseStage.CONTACT_ENDED) or not observed.sure:
            return False
        sound = all(f.response is Response.CONTINUE for f in observed.findings)
        return sound and self._motion.can_release(observed.q, observed.avoided)
