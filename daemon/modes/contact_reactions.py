"""Reactions to contact: for each level one choice of the configuration, and the event of the mode
table that it leads to. Pure data."""

from dataclasses import dataclass
from enum import StrEnum

from daemon.modes.table import Event, Mode


class ContactReaction(StrEnum):
    """Reaction of the armed arm to a contact."""

    REPORT = "report"  # nothing else
    ADMITTANCE = "admittance"  # yield, eq. (15)
    RETRACT = "retract"  # back away a fixed distance, the way it was pushed
    HOLD = "hold"  # decelerate and hold
    QUICK_STOP = "quick_stop"  # quick stop of all drives, latched until `reset`


class AfterQuiet(StrEnum):
    """Continuation of an interrupted trajectory when the quiet time is over."""

    RESUME = "resume"  # around where the person left the arm
    HOLD = "hold"  # not at all; it takes a new `start`
    RETURN = "return"  # from where the contact took it, after going back there slowly


EVENT_OF: dict[ContactReaction, Event | None] = {
    ContactReaction.REPORT: None,
    ContactReaction.ADMITTANCE: Event.TOUCH,
    ContactReaction.RETRACT: Event.RETRACT,
    ContactReaction.HOLD: Event.HALT,
    ContactReaction.QUICK_STOP: Event.FAULT,
}

# Where a contact counts as long as it lasts; elsewhere one is being reacted to already, and only a
# collision that begins is more than that.
ATTENTIVE = frozenset({Mode.HOLDING, Mode.TRACKING, Mode.RETURNING})


@dataclass(frozen=True, slots=True)
class Reactions:
    """Configured reaction to each level."""

    contact: ContactReaction = ContactReaction.ADMITTANCE
    collision: ContactReaction = ContactReaction.ADMITTANCE

    def to_contact(self, armed: bool) -> Event | None:
        """Event of a contact, as long as it lasts; None while the arm is not armed."""
        return EVENT_OF[self.contact] if armed else None

    def to_collision(self, armed: bool) -> Event | None:
        """Event of a collision that begins; while not armed, the arm stops whatever is chosen."""
        if armed or self.collision is ContactReaction.QUICK_STOP:
            return EVENT_OF[self.collision]
        return Event.HALT
