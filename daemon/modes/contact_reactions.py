"""Reactions to contact: the configured choice for each level, and the event of the mode table that
it causes. Pure data."""

from dataclasses import dataclass
from enum import StrEnum

from daemon.modes.table import Event, Mode


class ContactReaction(StrEnum):
    """Reaction to a contact or a collision."""

    REPORT = "report"  # only report it
    ADMITTANCE = "admittance"  # yield, eq. (15)
    RETRACT = "retract"  # back away a fixed distance, the way it was pushed
    RELEASE = "release"  # move slowly the way it is pushed, until the pressure is gone
    HOLD = "hold"  # decelerate and hold
    QUICK_STOP = "quick_stop"  # quick stop of all drives, latched until `reset`


class AfterQuiet(StrEnum):
    """Continuation of an interrupted trajectory when the quiet time is over."""

    RESUME = "resume"  # around where the person left the arm
    HOLD = "hold"  # none; it takes a new `start`
    RETURN = "return"  # from where the contact took it, after going back there slowly


EVENT_OF: dict[ContactReaction, Event | None] = {
    ContactReaction.REPORT: None,
    ContactReaction.ADMITTANCE: Event.TOUCH,
    ContactReaction.RETRACT: Event.RETRACT,
    ContactReaction.RELEASE: Event.RELEASE,
    ContactReaction.HOLD: Event.HALT,
    ContactReaction.QUICK_STOP: Event.FAULT,
}

# Modes in which a contact or collision causes a reaction as long as it lasts; in others one is in
# progress, and only the onset of a collision causes another.
ATTENTIVE = frozenset({Mode.HOLDING, Mode.TRACKING, Mode.RETURNING})


# Reactions to a collision that do not require the arm to be armed.
UNPERMITTED = frozenset({ContactReaction.RELEASE, ContactReaction.QUICK_STOP})


@dataclass(frozen=True, slots=True)
class Reactions:
    """Configured reaction to each level."""

    contact: ContactReaction = ContactReaction.ADMITTANCE
    collision: ContactReaction = ContactReaction.RELEASE

    def to_contact(self, armed: bool) -> Event | None:
        """Event of a contact, as long as it lasts; None while the arm is not armed."""
        return EVENT_OF[self.contact] if armed else None

    def to_collision(self, armed: bool) -> Event | None:
        """Event of a collision; without the permission that its reaction requires, a halt."""
        if armed or self.collision in UNPERMITTED:
            return EVENT_OF[self.collision]
        return Event.HALT
