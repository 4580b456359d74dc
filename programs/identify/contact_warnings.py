"""Warnings about a contact, for the person beside an arm that a step moves."""

from collections.abc import Callable

from daemon.config.schema import Joint
from daemon.protocol.state import Notice

_OF_LEVEL = 0.5  # that friction which is not known may take
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


def level_below_friction(joint: Joint, friction: float) -> tuple[str, ...]:
    """Sentence on the level to begin with, where slow friction [Nm] was seen that the configuration
    does not know, and its level would take for a touch; else none. In faster motion it is more."""
    known = joint.friction.motor_coulomb + joint.friction.link_coulomb
    level, off = joint.thresholds.contact, friction - known
    if not off > _OF_LEVEL * level:
        return ()
    return (
        f"{joint.name} rubs with {friction:.2g} Nm, {known:.2g} by the configuration: set its "
        f"thresholds.contact to {level + 2.0 * off:.2g} until `contactd identify thresholds`, or "
        "motion is taken for a touch",
    )


def other_joint_touched(joint: str) -> ContactWarning:
    """Warning about a contact of any joint except the one that a hand is to push."""

    def warning(event: Notice) -> str:
        contact = event.contact
        if contact is None or contact.joint == joint:
            return ""
        return f"contact at {contact.joint}, {contact.torque:+.2f} Nm: move {joint} alone"

    return warning
