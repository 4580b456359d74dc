"""Conditions, and the arm's responses to them.

HOLD is the response while the measurements can still be trusted: the arm decelerates and holds,
disarmed, and a person against whom it presses can guide it away after one `arm`. QUICK_STOP is the
response when they cannot, or when the drives may no longer follow: then nothing that is computed
from the measurements may move a joint, and the drives stop and hold by themselves until a person
has checked the arm.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from daemon.modes.table import Event
from drivers.api import Kind


class Response(IntEnum):
    """Response of the arm to a condition, in rising order of strength."""

    CONTINUE = 0  # recorded; arming is refused in such a tick
    HOLD = 1  # decelerate and hold, disarmed
    QUICK_STOP = 2  # quick stop of all drives, latched until `reset`
    FAULT_EXIT = 3  # quick stop of all drives, and the program exits with a non-zero status

    @property
    def event(self) -> Event | None:
        """Event of the mode table; None if the mode does not change."""
        if self is Response.CONTINUE:
            return None
        return Event.DOUBT if self is Response.HOLD else Event.FAULT


class Condition(StrEnum):
    """Condition of a fault, as shown to an operator."""

    SAMPLE_MISSING = "sample missing"
    STALE = "samples stale"
    NOT_SENSING = "not sensing contact"
    STARVED = "samples late with the machine"
    OLD = "samples a period old"
    HEARTBEAT_LOST = "heartbeat lost"
    UNHEARD = "the daemon was not heard by a drive"
    UNGUARDED = "no guardian"
    EMERGENCY = "emergency message"
    DRIVE_FAULT = "drive fault"
    DRIVE_DROPPED = "drive left operation"
    SUPPLY_LOST = "drive without supply"
    NOT_FOLLOWING = "drive does not follow"
    IGNORES_SETPOINT = "drive ignores its setpoint"
    NOT_SEEN_TO_STOP = "drive not seen to stop"
    UNPROVED = "drive not proved to stand"
    REBOOTED = "drive restarted"
    FOREIGN_MASTER = "another master on the bus"
    TWO_DRIVES = "two drives with one node number"
    BUS_LOADED = "bus loaded"
    BUS_DISTURBED = "bus disturbed"
    BUS_TROUBLE = "bus trouble"
    ERROR_PASSIVE = "bus error-passive"
    BUS_OFF = "bus off"
    ADAPTER_GONE = "adapter gone"
    NOT_FINITE = "not a finite number"
    JUMP = "encoder jump"
    FROZEN = "encoder frozen"
    APART = "motor and link apart"
    TORQUE_STUCK = "torque stuck"
    TORQUE_SATURATED = "torque saturated"
    RESIDUAL_LIMIT = "residual implausible"
    OVERSPEED = "too fast"
    JOINT_LIMIT = "beyond a joint limit"
    LATE = "late tick"
    OVERRUN = "too many late ticks"
    ABSENT = "the daemon was absent"
    PROGRAM_ERROR = "error in the program"


@dataclass(frozen=True, slots=True)
class Row:
    """Row of one condition; texts are Markdown."""

    response: Response
    check: str  # name of the arming check that fails with it
    when: str  # how it is detected
    why: str  # reason for this response
    advice: str  # advice for a person at the arm
    source: Kind | None = None  # event that always means this condition
