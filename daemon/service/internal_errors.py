"""Mishaps: errors of the program while it answers a request.

Such a request gets one refusal and one entry in the log. The loop continues; changes that the
request had made are undone, and if that is not possible the arm stops, or its drives quick-stop.
The tick is not protected in this way: an error in it is a fault.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from daemon.arming.permission import Permission
from daemon.modes.table import ENERGISED, Event, Mode
from daemon.motion.path import PathPoint
from daemon.protocol.lease import Lease
from daemon.protocol.requests import STILLING, Command
from daemon.protocol.text import printable
from daemon.tick.tick import Tick

_LONGEST: Final = 200  # characters of an error's own text


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """State of the arm before a request, as far as a failed request may have changed it."""

    mode: Mode
    armed: bool
    place: PathPoint
    lease: Lease | None

    @classmethod
    def of(cls, tick: Tick, permission: Permission) -> Self:
        """State now."""
        controller = tick.controller
        machine, place = controller.machine, controller.motion.follower.place
        return cls(machine.mode, machine.armed, place, permission.lease)

    def go_back(self, command: Command, tick: Tick, permission: Permission, time_s: float) -> None:
        """Undo the changes of `command` before it failed; if they cannot be undone, stop."""
        controller = tick.controller
        machine = controller.machine
        event = remedy(command, self, machine.mode, armed=machine.armed)
        if event is not None:
            controller.apply_event(event, f"internal error in {command}", time_s)
        if machine.mode is self.mode or machine.mode is Mode.OFF:
            controller.motion.follower.place = self.place
        permission.lease = self.lease if machine.armed else None


def remedy(command: Command, before: Checkpoint, mode: Mode, *, armed: bool) -> Event | None:
    """Event that follows a `command` which failed and left the arm in `mode`; None if the arm is
    not freer to move than before."""
    if command in STILLING and mode in ENERGISED:
        return Event.FAULT
    if mode is not before.mode:
        return Event.FAULT if before.mode is Mode.FAULTED else Event.STOP
    return Event.DISARM if armed and not before.armed else None


def error_in_words(error: Exception) -> str:
    """Type and text of an error, in one line."""
    text = printable(str(error))[:_LONGEST]
    return f"internal error: {type(error).__name__}" + (f": {text}" if text else "")


def place_of(error: Exception) -> str:
    """Function in which the error arose, with file and line; without reading its source."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return "nowhere"
    code = trace.tb_frame.f_code
    return f"{Path(code.co_filename).name}:{trace.tb_lineno} in {code.co_name}"
