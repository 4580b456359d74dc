"""Warnings about a contact, for the person beside an arm that a step moves."""

from collections.abc import Callable

from daemon.protocol.state import Notice

ContactWarning = Callable[[Notice], str]
"""Warning about a contact; empty where none is due."""


def discarded(event: Notice) -> str:
    """Warning for friction and thresholds, which leave out the time around a touch."""
    return f"{event.text}: if that was you, hands off; it is discarded"


def wiring_spoiled(joint: str) -> ContactWarning:
    """Warning for the wiring check, which needs all of its short motion; once for each joint."""
    warned: set[str] = set()

    def warning(event: Notice) -> str:
        touched = event.contact.joint if event.contact else ""
        if touched in warned:
            return ""
        warned.add(touched)
        return f"{event.text}: if that was you, hands off, and check the wiring of {joint} again"

    return warning


def ends_strokes(joint: str) -> ContactWarning:
    """Reason for which strokes of a joint end: a touch, or a drafted level below its friction."""

    def warning(event: Notice) -> str:
        if event.contact is None or event.contact.joint != joint:
            return event.text
        return (f"{event.text}; if no hand was there, {joint} rubs more than a level that was "
                f"guessed: set its thresholds.contact to {2.0 * abs(event.contact.torque):.2g} "
                "until `contactd identify thresholds`")  # fmt: skip

    return warning


def other_joint_touched(joint: str) -> ContactWarning:
    """Warning about a contact of any joint except the one that a hand is to push."""

    def warning(event: Notice) -> str:
        contact = event.contact
        if contact is None or contact.joint == joint:
            return ""
        return f"contact at {contact.joint}, {contact.torque:+.2f} Nm: move {joint} alone"

    return warning
