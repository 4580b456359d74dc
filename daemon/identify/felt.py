"""What a person is told when a joint feels a contact: each step does something else with it."""

from collections.abc import Callable

from daemon.protocol.messages import Event

Told = Callable[[Event], str]
"""Of a contact; empty where there is nothing to say."""


def left_out(event: Event) -> str:
    """Friction and thresholds learn nothing from what lies around a touch."""
    return f"{event.text}: if that was you, hands off; it is discarded"


def spoils_wiring_of(joint: str) -> Told:
    """The wiring is judged by all of so short a motion."""

    def told(event: Event) -> str:
        return f"{event.text}: if that was you, hands off, and check the wiring of {joint} again"

    return told


def alone(joint: str) -> Told:
    """A hand is to push this joint, of which there is nothing to say, and no other."""

    def told(event: Event) -> str:
        contact = event.contact
        if contact is None or contact.joint == joint:
            return ""
        return f"{contact.joint} feels {contact.torque:+.2f} Nm: move {joint} alone"

    return told
