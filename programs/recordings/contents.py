"""Contents of a recording: duration, modes, contacts, faults and lost States. Pure functions.

A contact lasts from its notice until the thresholded residual of its joint returns to zero, or
States are lost; a collision within that time belongs to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import msgspec

from daemon.protocol.state import Notice, Snapshot, State
from daemon.protocol.text import printable

EVENTS_KEPT: Final = 2000  # of each kind; further events are only counted


class ContactSeen(msgspec.Struct, kw_only=True):
    """One contact of a joint; times count from the first State [s]."""

    joint: str
    time_s: float
    tick: int
    level: Literal["contact", "collision"]  # the highest that it exceeded
    peak: float  # signed residual of the largest magnitude [Nm]
    threshold: float  # in force when it began [Nm]
    duration_s: float | None = None  # None: it lasts to the end of the recording

    @property
    def clear(self) -> float:
        """Ratio of peak to threshold."""
        return abs(self.peak) / max(abs(self.threshold), 1e-9)


class EventSeen(msgspec.Struct, frozen=True, kw_only=True):
    """Notice of the daemon; time from the first State [s]."""

    time_s: float
    tick: int
    kind: Literal["mode", "contact", "fault"]
    text: str


@dataclass(slots=True)
class Contents:
    """Contents of the States added so far."""

    joints: tuple[str, ...] = ()
    program: str = ""
    format: int = 0
    period_s: float = 0.0
    begun_wall_s: float | None = None
    begun_s: float | None = None  # loop time of the first State
    ended_s: float = 0.0
    states: int = 0
    lost: int = 0
    modes: dict[str, float] = field(default_factory=dict)  # seconds in each
    armed_s: float = 0.0
    contacts: list[ContactSeen] = field(default_factory=list)
    faults: list[EventSeen] = field(default_factory=list)
    events: list[EventSeen] = field(default_factory=list)  # all, including faults and contacts
    left_out: int = 0  # number of events that are only counted
    _tick: int | None = None
    _open: dict[str, ContactSeen] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """Time from the first State to the last [s]."""
        return 0.0 if self.begun_s is None else self.ended_s - self.begun_s

    def add_snapshot(self, snapshot: Snapshot) -> None:
        """Add the context of the States that follow."""
        self.joints, self.program = tuple(snapshot.joints), printable(snapshot.program)
        self.format, self.period_s = snapshot.format, snapshot.period_s

    def take(self, batch: Snapshot | list[State]) -> None:
        """Add the next batch of a recording."""
        if isinstance(batch, Snapshot):
            self.add_snapshot(batch)
        else:
            self.add(batch)

    def add(self, states: Sequence[State]) -> None:
        """Add the next States; ticks between batches may be missing."""
        for state in states:
            self._count(state)
            if state.notices:
                self._process_state(state)
            if self._open:
                self._follow(state)

    def _count(self, state: State) -> None:
        if self.begun_s is None:
            self.begun_s, self.begun_wall_s = state.time_s, state.timing.wall_s
        elif self._tick is not None and state.tick > self._tick + 1:
            self.lost += state.tick - self._tick - 1
            self._leave_open()
        self._tick, self.ended_s = state.tick, state.time_s
        self.states += 1
        mode = str(state.mode)
        self.modes[mode] = self.modes.get(mode, 0.0) + state.interval_s
        self.armed_s += state.interval_s * state.armed

    def _leave_open(self) -> None:
        """End open contacts at the last State before a gap: their further duration is unknown."""
        for contact in self._open.values():
            contact.duration_s = self.duration_s - contact.time_s
        self._open.clear()

    def _process_state(self, state: State) -> None:
        assert self.begun_s is not None
        time_s = state.time_s - self.begun_s
        for notice in state.notices:
            if notice.contact is not None:
                self._begin(notice, state.tick, time_s)
            event = EventSeen(time_s=time_s, tick=state.tick, kind=notice.kind,
                              text=printable(notice.text))  # fmt: skip
            for kept in (self.events, *([self.faults] if notice.kind == "fault" else [])):
                if len(kept) < EVENTS_KEPT:
                    kept.append(event)
                else:
                    self.left_out += kept is self.events

    def _begin(self, notice: Notice, tick: int, time_s: float) -> None:
        contact = notice.contact
        assert contact is not None
        if (lasting := self._open.get(contact.joint)) is not None:
            if lasting.peak * contact.torque > 0.0:
                lasting.level = max(lasting.level, contact.level, key=LEVEL_ORDER.index)
                return
            lasting.duration_s = time_s - lasting.time_s
        seen = ContactSeen(joint=printable(contact.joint), time_s=time_s, tick=tick,
                           level=contact.level, peak=contact.torque,
                           threshold=contact.threshold)  # fmt: skip
        self._open[contact.joint] = seen
        if len(self.contacts) < EVENTS_KEPT:
            self.contacts.append(seen)

    def _follow(self, state: State) -> None:
        """Update peak and end of open contacts."""
        assert self.begun_s is not None
        for joint, contact in list(self._open.items()):
            i = self.joints.index(joint) if joint in self.joints else None
            if i is None or state.thresholded[i] * contact.peak <= 0.0:
                contact.duration_s = state.time_s - self.begun_s - contact.time_s
                del self._open[joint]
            elif abs(state.residual[i]) > abs(contact.peak):
                contact.peak = state.residual[i]


LEVEL_ORDER: Final = ("contact", "collision")
