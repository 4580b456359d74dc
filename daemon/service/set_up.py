"""Set-up of the drives, proved by reading it back before the arm is enabled or a fault is reset.

What was written at the start may not be there any more, and no message need have said so: another
tool has written to a drive, or it has restarted by itself and nobody heard it. So all drives are
read first, and those that do not hold what they must are set up again.
"""

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Final

from daemon.modes.table import Event
from daemon.motion.path import JointPath
from daemon.tick.tick import Tick
from drivers.boot.boot_up import DriveBoot
from errors import ContactdError

#: Events that only drives with a proved set-up may follow.
PROVED: Final = frozenset({Event.ENABLE, Event.RESET})
_log = logging.getLogger("contactd")


@dataclass(slots=True)
class SetUp:
    """Set-up of one arm's drives. All is done between two ticks, by SDO: the arm stands in quick
    stop or without torque, and nobody ticks meanwhile."""

    boot: DriveBoot
    tick: Tick
    time_s: Callable[[], float]
    """of the loop [s]"""
    meanwhile: Callable[[], None] = lambda: None
    """called while drives answer or are given up: feeds the watchdog"""
    resume: Callable[[], None] = lambda: None
    """called after the pause in ticking"""
    by_sdo: Callable[[], AbstractContextManager[None]] = nullcontext
    """entered while there is SDO on the bus, and no tick"""

    def request(self, event: Event, who: str, path: JointPath | None = None) -> list[str]:
        """Carry out an event that somebody asks for, `enable` and `reset` only with drives whose
        set-up was proved; returns the reasons of a refusal, empty when it was done."""
        controller = self.tick.controller
        # What is refused anyway must not make the loop pause.
        if event in PROVED and controller.machine.can(event):
            refused = self._refusals(event)
            if reasons := refused or self.prove():
                return reasons
        reasons = controller.request(event, who, self.time_s(), path)
        if event is Event.RESET and not reasons:
            self.tick.arming_checks.forget()
        return reasons

    def _refusals(self, event: Event) -> list[str]:
        drives = self.tick.drives
        if event is Event.ENABLE:
            return self.tick.controller.refusals(event)
        if drives.silenced or not (unproved := drives.unproved()):
            return []
        # In a moment they stand, or are left to themselves.
        return [f"not seen to stand yet: {', '.join(unproved)}; try again"]

    def prove(self) -> list[str]:
        """Verify all drives, and set up again those that need it; returns why that failed."""
        drives, boot = self.tick.drives, self.boot
        renewed: list[int] = []
        try:
            with self.by_sdo():
                unset = self._not_set_up()
                if unset:
                    boot.renew(unset, self.meanwhile, _log.info)
                renewed = unset
        except ContactdError as error:
            return str(error).splitlines()
        else:
            return []
        finally:
            drives.counters.dropped_events += boot.heard.dropped
            drives.start(self.time_s(), renewed, boot.heard.take())
            self.tick.arming_checks.renewed(renewed)
            self.resume()

    def _not_set_up(self) -> list[int]:
        """Joints whose drives must be set up again: known to, or found by reading; the log says
        why."""
        drives = self.tick.drives
        known = drives.unfit()
        for i in known:
            _log.warning("%s: silent, restarted, or locked: it is set up again", drives.names[i])
        others = [i for i in range(len(drives.names)) if i not in known]
        found = self.boot.verify(others, self.meanwhile)
        for i, problems in found.items():
            for problem in problems:
                _log.warning("%s: %s: it is set up again", self.boot.setups[i], problem)
        drives.distrust([*known, *found])
        return sorted([*known, *found])
