"""Stages of the release of a contact, and their transitions: a state machine beside the modes. Pure
data.

They decide whether a contact that lasts after a release may be released again, and where the arm
stands after one: see `daemon/tick/contact_events.py` and `Controller`.
"""

from enum import StrEnum

from daemon.modes.table import Event


class ReleaseStage(StrEnum):
    """Stage of the release of the present contact."""

    NONE = "none"  # no contact, or none that was released
    CONTACT_ENDED = "let go"  # the contact was released, and the arm is stopping
    RELEASED = "released"  # as far as allowed; not again while the contact lasts
    # Ended only because sensing was not reliable: the contact still counts as a collision, down to
    # the contact level, and may be released again.
    UNFINISHED = "unfinished"


class Ending(StrEnum):
    """Reason for the end of a release."""

    CONTACT_ENDED = "let go"
    BOUND = "at a bound, and still pressed"
    TIME = "still pressed after its time"
    ELSEWHERE = "pressed from elsewhere"
    UNSURE = "sensing not sure"


# Stages after a release, in which the contact may last.
LEFT = frozenset({ReleaseStage.CONTACT_ENDED, ReleaseStage.RELEASED, ReleaseStage.UNFINISHED})

# Stage after a release, by the event and the reason that ended it; else RELEASED.
_AFTER: dict[tuple[Event, Ending | None], ReleaseStage] = {
    (Event.HALT, Ending.CONTACT_ENDED): ReleaseStage.CONTACT_ENDED,
    (Event.HALT, Ending.UNSURE): ReleaseStage.UNFINISHED,
}


def after_release(event: Event, end: Ending | None) -> ReleaseStage:
    """Stage after a release that `event` ended; `end` is None if the release was interrupted."""
    if event is Event.DOUBT:
        return ReleaseStage.UNFINISHED
    return _AFTER.get((event, end), ReleaseStage.RELEASED)


def after_change(stage: ReleaseStage) -> ReleaseStage:
    """Stage after any other change of the mode."""
    return ReleaseStage.RELEASED if stage is ReleaseStage.CONTACT_ENDED else stage
