"""Symptoms of faults: the section of docs/troubleshooting.md for each condition, and the advice
that refers to it.

A fault names a condition; a section of that page starts from the symptom a person sees, and lists
its causes by frequency. Several conditions share a section.
"""

from typing import Final

from daemon.faults.conditions import Condition
from daemon.faults.table import TABLE

PAGE: Final = "docs/troubleshooting.md"
_C = Condition

SECTION_OF: Final[dict[Condition, str]] = {
    _C.SAMPLE_MISSING: "a-drive-falls-silent",
    _C.STALE: "a-drive-falls-silent",
    _C.OLD: "it-is-late",
    _C.HEARTBEAT_LOST: "a-drive-falls-silent",
    _C.BUS_LOADED: "a-drive-falls-silent",
    _C.BUS_DISTURBED: "a-drive-falls-silent",
    _C.BUS_TROUBLE: "a-drive-falls-silent",
    _C.ERROR_PASSIVE: "a-drive-falls-silent",
    _C.BUS_OFF: "a-drive-falls-silent",
    _C.ADAPTER_GONE: "a-drive-falls-silent",
    _C.NOT_SENSING: "it-does-not-feel-me",
    _C.TORQUE_STUCK: "it-does-not-feel-me",
    _C.STARVED: "it-is-late",
    _C.LATE: "it-is-late",
    _C.OVERRUN: "it-is-late",
    _C.ABSENT: "it-is-late",
    _C.UNHEARD: "a-drive-falls-silent",
    _C.UNGUARDED: "a-drive-falls-silent",
    _C.EMERGENCY: "a-drive-gives-up",
    _C.DRIVE_FAULT: "a-drive-gives-up",
    _C.DRIVE_DROPPED: "a-drive-gives-up",
    _C.SUPPLY_LOST: "a-drive-gives-up",
    _C.REBOOTED: "a-drive-gives-up",
    _C.NOT_FOLLOWING: "a-drive-does-what-it-likes",
    _C.IGNORES_SETPOINT: "a-drive-does-what-it-likes",
    _C.FOREIGN_MASTER: "a-drive-does-what-it-likes",
    _C.TWO_DRIVES: "a-drive-does-what-it-likes",
    _C.OVERSPEED: "a-drive-does-what-it-likes",
    _C.NOT_SEEN_TO_STOP: "it-is-not-seen-to-stop",
    _C.UNPROVED: "it-is-not-seen-to-stop",
    _C.JUMP: "motor-and-link-apart",
    _C.FROZEN: "motor-and-link-apart",
    _C.APART: "motor-and-link-apart",
    _C.TORQUE_SATURATED: "it-presses",
    _C.JOINT_LIMIT: "it-presses",
    _C.RESIDUAL_LIMIT: "it-yields-without-a-touch",
    _C.NOT_FINITE: "the-program-fails",
    _C.PROGRAM_ERROR: "the-program-fails",
}


def advice_of(condition: Condition) -> str:
    """Advice for a person at the arm about a condition, with a reference to the section."""
    return f"{TABLE[condition].advice}; more: {PAGE}#{SECTION_OF[condition]}"
