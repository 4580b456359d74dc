"""Queue of events until the samples of their tick: bounded, without duplicates."""

from typing import Final, Generic, TypeVar

EventT = TypeVar("EventT")

#: Bound per tick: a flooded bus must not exhaust the memory.
EVENTS_PER_TICK: Final = 32


class EventQueue(Generic[EventT]):
    """Event queue of one arm; events that exceed its bound are dropped."""

    def __init__(self) -> None:
        self._events: list[EventT] = []

    def report(self, *events: EventT | None) -> None:
        """Queue events for the next samples; None is ignored."""
        for event in events:
            room = len(self._events) < EVENTS_PER_TICK
            if room and event is not None and event not in self._events:
                self._events.append(event)

    def take(self) -> tuple[EventT, ...]:
        """Return all queued events, and clear the queue."""
        events = tuple(self._events)
        self._events.clear()
        return events
