"""Set-up of the drives, verified by reading it back before the arm is enabled or a fault is reset.

The values written at the start may have been lost without any message: another tool has written to
a drive, or a drive has restarted unnoticed. Therefore all drives are read first, and those whose
values differ are set up again.
"""

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Final

from common.errors import ContactdError
from daemon.modes.table import Event
from daemon.motion.path import JointPath
from daemon.tick.tick import Tick
from drivers.api import BootableDrives

#: Events that require drives with a verified set-up.
PROVED: Final = frozenset({Event.ENABLE, Event.RESET})
_log = logging.getLogger("contactd")


@dataclass(slots=True)
class SetUp:
    """Set-up of one arm's drives, between two ticks: the arm stands stopped or without torque, and
    no tick runs meanwhile."""

    drives: BootableDrives
    tick: Tick
    time_s: Callable[[], float]
    """Time of the loop [s]"""
    meanwhile: Callable[[], None] = lambda: None
    """Called while waiting for drives: feeds the watchdog"""
    resume: Callable[[], None] = lambda: None
    """Called after the pause in ticking"""
    asking: Callable[[], AbstractContextManager[None]] = nullcontext
    """Context in which drives are queried, and no tick runs"""

    def request(self, event: Event, who: str, path: JointPath | None = None) -> list[str]:
        """Carry out a requested event, `enable` and `reset` only with drives whose set-up is
        verified; returns the reasons for a refusal, empty if it was done."""
        controller = self.tick.controller
        # A request that is refused anyway must not make the loop pause.
        if event in PROVED and controller.machine.can(event):
            refused = self._refusals(event)
            if reasons := refused or self.prove():
                return reasons
        reasons = controller.request(event, who, self.time_s(), path)
        if event is Event.RESET and not reasons:
            self.drives.acknowledge()
        return reasons

    def _refusals(self, event: Event) -> list[str]:
        drives = self.drives
        if event is Event.ENABLE:
            return self.tick.controller.refusals(event)
        if drives.master_timeout_passed or not (unproved := drives.unproved()):
            return []
        # They will stand soon, or the daemon will send nothing to them any more.
        return [
            f"not seen to stand yet: {', '.join(unproved)}; try again, and if it stands, "
            "move its link a little by hand first: a sensor that never changes proves nothing"
        ]

    def prove(self) -> list[str]:
        """Verify all drives, and set up again those that need it; returns the reasons for a
        failure."""
        renewed: list[int] = []
        try:
            with self.asking():
                renewed = self.drives.prove(self.meanwhile, _log.info, _log.warning)
        except ContactdError as error:
            return str(error).splitlines()
        else:
            return []
        finally:
            self.drives.start(self.time_s(), renewed)
            self.resume()
