"""From one tick's samples and estimate to the supervisor's findings. No I/O."""

from collections.abc import Iterator, Sequence

import numpy as np

from daemon.modes import SENSING, Mode
from daemon.supervisor import Condition, Finding
from drivers.cia402 import DriveState
from drivers.events import (
    BadSetpoint,
    BusTrouble,
    Emergency,
    Event,
    ForeignMaster,
    HeartbeatLost,
    NotOperational,
    Rebooted,
)
from drivers.samples import Samples

CONDITION_OF: dict[type[Event], Condition] = {
    HeartbeatLost: Condition.HEARTBEAT_LOST,
    Emergency: Condition.EMERGENCY,
    Rebooted: Condition.REBOOTED,
    NotOperational: Condition.DRIVE_DROPPED,
    ForeignMaster: Condition.FOREIGN_MASTER,
    BadSetpoint: Condition.NOT_FINITE,
}
FAULT_STATES = (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)


class Observer:
    """Counts what takes several ticks to become a doubt: stale samples, bus trouble, overruns."""

    def __init__(self, names: Sequence[str], stale_ticks: int, overrun_ticks: int) -> None:
        self._names = tuple(names)
        self._stale_ticks, self._overrun_ticks = stale_ticks, overrun_ticks
        self._late_in_row = 0
        self._trouble_in_row = 0

    def findings(
        self, samples: Samples, mode: Mode, late: bool, finite: bool
    ) -> tuple[Finding, ...]:
        """Every condition that holds in this tick; empty in an undisturbed one."""
        self._late_in_row = self._late_in_row + 1 if late else 0
        trouble = [event for event in samples.events if isinstance(event, BusTrouble)]
        self._trouble_in_row = self._trouble_in_row + 1 if trouble else 0
        return (
            *self._of_events(samples.events, trouble),
            *self._of_samples(samples),
            *self._of_drives(samples, mode),
            *self._of_time(late),
            *(() if finite else (Finding(Condition.NOT_FINITE, "in the drives' samples"),)),
        )

    def _of_events(
        self, events: Sequence[Event], trouble: Sequence[BusTrouble]
    ) -> Iterator[Finding]:
        for event in events:
            # Code 0 says that an earlier emergency is over.
            over = isinstance(event, Emergency) and event.code == 0
            if not over and (condition := CONDITION_OF.get(type(event))):
                yield Finding(condition, str(event))
        if self._trouble_in_row >= self._stale_ticks:
            yield Finding(Condition.BUS_TROUBLE, str(trouble[0]))

    def _of_samples(self, samples: Samples) -> Iterator[Finding]:
        if samples.fresh.all():
            return
        stale = np.flatnonzero(samples.age_ticks >= self._stale_ticks)
        if stale.size:
            names = ", ".join(self._names[i] for i in stale)
            yield Finding(Condition.STALE, f"nothing from {names} for {self._stale_ticks} ticks")
        else:
            names = ", ".join(self._names[i] for i in np.flatnonzero(~samples.fresh))
            yield Finding(Condition.SAMPLE_MISSING, names)

    def _of_drives(self, samples: Samples, mode: Mode) -> Iterator[Finding]:
        energised = mode in SENSING
        for name, state in zip(self._names, samples.states, strict=True):
            if state is DriveState.OPERATION_ENABLED:
                continue
            if state in FAULT_STATES:
                yield Finding(Condition.DRIVE_FAULT, name)
            elif energised:
                words = state.name.lower().replace("_", " ")
                yield Finding(Condition.DRIVE_DROPPED, f"{name} is in {words}")

    def _of_time(self, late: bool) -> Iterator[Finding]:
        if self._late_in_row >= self._overrun_ticks:
            yield Finding(Condition.OVERRUN, f"{self._late_in_row} in a row")
        elif late:
            yield Finding(Condition.LATE, "")
