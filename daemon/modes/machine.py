"""State machine of the modes: mode, its cause, permission, and state of the trajectory."""

from dataclasses import dataclass
from typing import Literal

from daemon.modes.table import (
    DISARMING,
    FORGETTING,
    GUIDED,
    HALTING,
    WAITING,
    Event,
    Mode,
    next_mode,
)


@dataclass(frozen=True, slots=True)
class Change:
    """Change of the mode or of the permission, with its cause."""

    text: str
    cause: str


@dataclass(frozen=True, slots=True)
class Trigger:
    """Event that may change the mode, with its cause."""

    event: Event
    cause: str


class ModeMachine:
    """Present mode, and the permission beside it.

    `changes` collects every change with its cause; the tick reports them and clears the list.
    """

    def __init__(self) -> None:
        self.changes: list[Change] = []
        self.mode = Mode.OFF
        self.armed = False
        self.disarmed = ("", 0.0)  # cause and time of the last end of arming
        self.moving = False  # a trajectory runs, or continues after this contact
        self.paused = False  # a trajectory was halted, and continues with the next `start`
        self.cause = "started"
        self.entered_s = 0.0  # time at which the mode was entered
        self.entered_by: Event | None = None  # None: the start
        self._disable_pending = False

    @property
    def trajectory(self) -> Literal["ready", "running", "interrupted", "paused"]:
        """State of the trajectory; an interrupted one continues after this contact."""
        if self.moving:
            return "running" if self.mode is Mode.TRACKING else "interrupted"
        return "paused" if self.paused else "ready"

    def arm(self, cause: str) -> None:
        """Allow contacts to lead to admittance. The arming checks have passed by then."""
        if not self.armed:
            self.armed = True
            self.changes.append(Change("armed", cause))

    def can(self, event: Event) -> bool:
        """True if the table has a row for `event` in this mode."""
        return next_mode(self.mode, event) is not None

    def apply(self, event: Event, cause: str, time_s: float) -> bool:
        """Apply an event; returns False, without any change, if the table has no row for it.

        `disable` in motion first stops the arm; the drives go off when it holds.
        """
        after = next_mode(self.mode, event)
        if after is None:
            return False
        if event in DISARMING and self.armed:
            self.armed, self.disarmed = False, (cause, time_s)
            self.changes.append(Change("disarmed", cause))
        forgets = event is Event.ABANDON and (self.paused or self.moving)
        if event in HALTING:
            self.paused = self.paused or self.moving
        elif after is Mode.TRACKING or event in FORGETTING:
            self.paused = False
        # Only after a contact does a trajectory continue by itself.
        guided = self.moving and after in GUIDED and event not in WAITING
        self.moving = guided or after is Mode.TRACKING
        if after is not self.mode:
            self.changes.append(Change(f"{self.mode} -> {after}", cause))
            self.mode, self.cause = after, cause
            self.entered_by, self.entered_s = event, time_s
        elif forgets:
            # The mode does not change.
            self.changes.append(Change("trajectory forgotten", cause))
            self.cause = f"{self.cause}; {cause}"
        if event is Event.DISABLE:
            self._disable_pending = after is Mode.STOPPING
        elif after is Mode.FAULTED:
            self._disable_pending = False
        if after is Mode.HOLDING and self._disable_pending:
            self.apply(Event.DISABLE, "disabled", time_s)
        return True
