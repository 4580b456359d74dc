"""When doubt becomes a reaction: one pure table of conditions.

Each tick the controller describes what it observed; the supervisor names the conditions that hold
and the strongest reaction among them.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from daemon.modes import Event


class Reaction(IntEnum):
    """In rising order of strength."""

    CONTINUE = 0
    HOLD = 1  # decelerate and hold, disarmed
    QUICK_STOP = 2  # quick stop of all drives, latched until `reset`


class Condition(StrEnum):
    """What may be wrong."""

    SAMPLE_MISSING = "sample missing"
    STALE = "samples stale"
    HEARTBEAT_LOST = "heartbeat lost"
    EMERGENCY = "emergency message"
    DRIVE_FAULT = "drive fault"
    DRIVE_DROPPED = "drive left operation"
    REBOOTED = "drive restarted"
    FOREIGN_MASTER = "another master on the bus"
    BUS_TROUBLE = "bus trouble"
    NOT_FINITE = "not a finite number"
    LATE = "late tick"
    OVERRUN = "too many late ticks"


REACTIONS: dict[Condition, Reaction] = {
    Condition.SAMPLE_MISSING: Reaction.CONTINUE,
    Condition.STALE: Reaction.QUICK_STOP,
    Condition.HEARTBEAT_LOST: Reaction.QUICK_STOP,
    Condition.EMERGENCY: Reaction.QUICK_STOP,
    Condition.DRIVE_FAULT: Reaction.QUICK_STOP,
    Condition.DRIVE_DROPPED: Reaction.QUICK_STOP,
    Condition.REBOOTED: Reaction.QUICK_STOP,
    Condition.FOREIGN_MASTER: Reaction.QUICK_STOP,
    Condition.BUS_TROUBLE: Reaction.QUICK_STOP,
    Condition.NOT_FINITE: Reaction.QUICK_STOP,
    Condition.LATE: Reaction.CONTINUE,
    Condition.OVERRUN: Reaction.QUICK_STOP,
}

EVENT_OF: dict[Reaction, Event | None] = {
    Reaction.CONTINUE: None,
    Reaction.HOLD: Event.DOUBT,
    Reaction.QUICK_STOP: Event.FAULT,
}


@dataclass(frozen=True, slots=True)
class Finding:
    """A condition that holds, and where: "joint LElbowRoll (node 3)"."""

    condition: Condition
    text: str

    @property
    def reaction(self) -> Reaction:
        """What the table asks for."""
        return REACTIONS[self.condition]

    def __str__(self) -> str:
        return f"{self.condition.value}: {self.text}" if self.text else self.condition.value


def strongest(findings: tuple[Finding, ...]) -> Finding | None:
    """The finding whose reaction wins; the first among equals."""
    return max(findings, key=lambda finding: finding.reaction, default=None)
