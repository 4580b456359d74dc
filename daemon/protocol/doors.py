"""Doors of the daemon: two sockets, the group of each, and the commands that it takes. Pure.

Clients of the control socket command the arm. The view socket is for observers, which may also
stop it: a web page, a display, a logger. No command of it starts a motion.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from contactd_client.paths import CONTROL_GROUP, VIEW_GROUP
from daemon.protocol.requests import COMMANDS, VIEWED


class Door(StrEnum):
    """Door of the daemon."""

    CONTROL = "control"
    VIEW = "view"


@dataclass(frozen=True, slots=True)
class DoorRule:
    """Group that may use a door, commands that it takes, and connections that it may hold."""

    group: str
    commands: frozenset[str]
    connections: int


MAX_CONNECTIONS: Final = 256  # silent ones cost nothing, others wait for their turn

DOORS: Final[dict[Door, DoorRule]] = {
    Door.CONTROL: DoorRule(CONTROL_GROUP, frozenset(COMMANDS), MAX_CONNECTIONS),
    # Always leaves places for clients that command the arm.
    Door.VIEW: DoorRule(VIEW_GROUP, VIEWED, 64),
}


def refusal(door: Door, command: str) -> str:
    """Reason why `door` does not take `command`; empty if it does."""
    taken = DOORS[door].commands
    if command in taken:
        return ""
    return f"the {door} socket takes only {', '.join(sorted(taken))}"
