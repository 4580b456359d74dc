"""Events until the samples of their tick: each once, within bounds."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.answers import Counters
from drivers.canopen.events import BusEvent

#: Bound of one tick: a flooded bus must not take the memory.
EVENTS_PER_TICK: Final = 32

Report = Callable[[BusEvent | None], None]


class EventQueue:
    """Queue of one arm; what finds no room is counted."""

    def __init__(self, counters: Counters) -> None:
        self._counters = counters
        self._events: list[BusEvent] = []

    def report(self, *events: BusEvent | None) -> None:
        """Keep events for the next samples; None is ignored."""
        for event in events:
            if event is None or event in self._events:
                continue
            if len(self._events) < EVENTS_PER_TICK:
                self._events.append(event)
            else:
                self._counters.dropped_events += 1

    def take(self) -> tuple[BusEvent, ...]:
        """All events so far, which are then forgotten here."""
        events = tuple(self._events)
        self._events.clear()
        return events
