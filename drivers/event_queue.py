"""Events until the samples of their tick: each once, within bounds."""

from typing import Final, Generic, TypeVar

EventT = TypeVar("EventT")

#: Bound of one tick: a flooded bus must not take the memory.
EVENTS_PER_TICK: Final = 32


class EventQueue(Generic[EventT]):
    """Queue of one arm; what finds no room is lost."""

    def __init__(self) -> None:
        self._events: list[EventT] = []

    def report(self, *events: EventT | None) -> None:
        """Keep events for the next samples; None is ignored."""
        for event in events:
            room = len(self._events) < EVENTS_PER_TICK
            if room and event is not None and event not in self._events:
                self._events.append(event)

    def take(self) -> tuple[EventT, ...]:
        """All events so far, which are then forgotten here."""
        events = tuple(self._events)
        self._events.clear()
        return events
