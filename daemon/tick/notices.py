"""Notices of a tick, about sensing, faults, modes and contacts."""

from collections.abc import Sequence
from typing import Final

from daemon.faults.conditions import Condition, Response
from daemon.faults.finding import Finding
from daemon.modes.machine import ModeMachine
from daemon.modes.table import Mode
from daemon.protocol.state import Notice
from daemon.tick.sensing import Sensing, SensingNotices
from daemon.tick.telemetry import contact_notice
from estimator.contact import Contact

STOP_PROVED: Final = "stop proved: every drive is at standstill"


class Notices:
    """Notices of one arm, tick by tick. A finding is reported once until the latch is reset."""

    def __init__(self, names: Sequence[str], machine: ModeMachine) -> None:
        """names: of the joints, (n,)."""
        self._machine = machine
        self._sensing = SensingNotices(names)
        self._reported: frozenset[Finding] = frozenset()
        self._proved = False  # every stop, in the previous tick

    def step(
        self,
        time_s: float,
        sensing: Sensing,
        findings: tuple[Finding, ...],
        contacts: Sequence[Contact],
        unproved: Sequence[str],
        others: Sequence[Notice],
    ) -> tuple[Notice, ...]:
        """Notices of a tick, with `others`; unproved: joints that are not confirmed at
        standstill."""
        notices = [*self._sensing.step(time_s, sensing, findings), *others]
        faulted = self._machine.mode is Mode.FAULTED
        if findings or self._reported:
            notices += [
                Notice(kind="fault", text=str(finding))
                for finding in findings
                if finding.response > Response.CONTINUE
                and finding not in self._reported
                and finding.condition is not Condition.NOT_SENSING  # reported by SensingNotices
            ]
            self._reported = (self._reported if faulted else frozenset()).union(findings)
        changes = self._machine.changes
        notices += [Notice(kind="mode", text=f"{one.text}: {one.cause}") for one in changes]
        changes.clear()
        if faulted and not unproved and not self._proved:
            notices.append(Notice(kind="mode", text=STOP_PROVED))
        self._proved = not unproved
        notices += map(contact_notice, contacts)
        return tuple(notices)
