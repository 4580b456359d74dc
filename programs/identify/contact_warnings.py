"""Warnings about contacts for the person beside an arm that a step moves."""

from collections.abc import Callable

from daemon.config.schema import Joint
from daemon.protocol.state import Notice

_OF_LEVEL = 0.5  # share of the contact level that unmodelled friction may take
ContactWarning = Callable[[Notice], str]
"""Function that returns the warning about a contact; empty for no warning."""


def discarded(event: Notice) -> str:
    """Warning during friction and thresholds, which discard the time around a touch."""
    return f"{event.text}: if that was you, hands off; it is discarded"


def wiring_touched(joint: str) -> ContactWarning:
    """Warning during the wiring check, which a touch spoils; given once for each joint."""
    warned: set[str] = set()

    def warning(event: Notice) -> str:
        touched = event.contact.joint if event.contact else ""
        if touched in warned:
            return ""
        warned.add(touched)
        return f"{event.text}: if that was you, hands off, and check the wiring of {joint} again"

    return warning


def ends_strokes(joint: str) -> ContactWarning:
    """Warning during strokes of a joint, which a contact ends: a touch, or a drafted contact level
    below the joint's friction."""

    def warning(event: Notice) -> str:
        if event.contact is None or event.contact.joint != joint:
            return event.text
        return (f"{event.text}; if it was not touched, friction of {joint} exceeds the guessed "
                f"level: set its thresholds.contact to {2.0 * abs(event.contact.torque):.2g} "
                "until `contactd identify thresholds`")  # fmt: skip

    return warning


def level_below_friction(joint: Joint, friction: float) -> tuple[str, ...]:
    """Sentence on the contact level to begin with, if friction [Nm] of slow motion exceeds the
    configured one so far that it could be taken for a touch; else none. It grows with speed."""
    known = joint.friction.motor_coulomb + joint.friction.link_coulomb
    level, off = joint.thresholds.contact, friction - known
    if not off > _OF_LEVEL * level:
        return ()
    return (
        f"{joint.name}: friction of {friction:.2g} Nm, {known:.2g} in the configuration: set its "
        f"thresholds.contact to {level + 2.0 * off:.2g} until `contactd identify thresholds`, or "
        "motion is taken for a touch",
    )


def other_joint_touched(joint: str) -> ContactWarning:
    """Warning about a contact of any joint but the one that the hand is to move."""

    def warning(event: Notice) -> str:
        contact = event.contact
        if contact is None or contact.joint == joint:
            return ""
        return f"contact at {contact.joint}, {contact.torque:+.2f} Nm: move {joint} alone"

    return warning
