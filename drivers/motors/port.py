"""Port of an arm to its bus: frames in and out, and the events of both. No failure of the bus is an
exception.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

from drivers.api import Event, Kind
from drivers.can.bus import BUS_FAILURES
from drivers.can.failures import bus_failure, error_frame
from drivers.can.traffic import Traffic
from drivers.can.wire import ERROR, IDENTIFIER, Frame, Wire
from drivers.event_queue import EventQueue
from drivers.motors.guardian import BEAT, GONE_S, Doing
from drivers.motors.language import Language
from drivers.motors.replies import Replies

#: Bound of a pass: a flooded bus must not hold the loop.
FRAMES_PER_PASS: Final = 512


class Port:
    """Port with the replies that it feeds; only we, and a guardian, may command the motors."""

    def __init__(
        self,
        wire: Wire,
        replies: Replies,
        traffic: Traffic,
        language: Language,
        on_bus_off: Callable[[], None],
        on_held: Callable[[int, float], None],
    ) -> None:
        """on_held takes a joint and the position at which the guardian holds its motor [rad]."""
        self._wire, self._replies, self._traffic = wire, replies, traffic
        self._language = language
        self._on_bus_off, self._on_held = on_bus_off, on_held
        events: EventQueue[Event] = EventQueue()
        self.report, self.events = events.report, events.take
        self.now = 0.0
        """Time of the tick [s]."""
        self._beat_s = -math.inf  # of the guardian
        self._guarded = self.taken_over = False
        """A guardian holds motors."""
        self._begun_s = 0.0
        self.zeroed: set[int] = set()
        """Joints whose motors another gave a new zero."""

    def begin(self, now: float) -> None:
        """Begin to tick."""
        self.now = self._begun_s = now
        self._traffic.begin(now, self._replies.late_frames)
        if self.taken_over:  # as heard before
            self._beat_s, self._guarded = now, True

    def send(self, frames: Sequence[Frame]) -> bool:
        """Send; False, and an event, if the bus does not take them all."""
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self.report(bus_failure("sending", error))
            return False
        return True

    def take_next(self, timeout: float) -> bool:
        """Take the next frame, waiting at most `timeout` s; False if there is none, or the bus
        fails."""
        try:
            frame = self._wire.receive(timeout)
        except BUS_FAILURES as error:
            self.report(bus_failure("receiving", error))
            return False
        if frame is None:
            return False
        self._take(*frame)
        return True

    def read_queued(self) -> bool:
        """Take the queued frames; False if there are more than a pass reads."""
        return not all(self.take_next(0.0) for _ in range(FRAMES_PER_PASS))

    def _take(self, can_id: int, data: bytes | bytearray) -> None:
        language = self._language
        if (joint := language.answering(can_id)) is not None:
            if not self._replies.take(joint, can_id, data):
                text = f"an answer at {_named(can_id)} cannot be its own"
                self.report(Event(Kind.DISTURBED, text))
            return
        if can_id & ERROR:
            event = error_frame(can_id & ~ERROR, data)
            if event.kind is Kind.OFF_BUS:
                self._on_bus_off()
            self.report(event)
            return
        if (joint := language.zeroed(can_id)) is not None:
            self._replies.forget(joint)  # an old p would throw it
            self._on_held(joint, math.nan)
            self.zeroed.add(joint)
        joint = language.commanded(can_id)
        self._traffic.take(can_id, len(data), unknown=joint is None and can_id != BEAT)
        if can_id == BEAT and len(data):
            self._beat_s, self._guarded = self.now, True
            self.taken_over = data[0] != Doing.WATCHES
        elif joint is not None and self.taken_over:
            if (found := language.setpoint_of(joint, can_id, data)) is not None:
                self._on_held(joint, found[0])
            if self.now - self._begun_s > GONE_S:  # at the start it has held the arm in order
                self.report(Event(Kind.ABSENT, "the guardian held the arm meanwhile"))
        elif language.masters(can_id):
            self.report(Event(Kind.FOREIGN_MASTER, f"it sends {_named(can_id)}"))

    @property
    def guarded(self) -> bool:
        """True while a guardian is heard."""
        return self.now - self._beat_s <= GONE_S

    def end_tick(self) -> None:
        """Report a bus that others load, and a guardian that has gone, once."""
        self._traffic.step(self.now, self._replies.late_frames)
        if loaded := self._traffic.loaded:
            self.report(Event(Kind.LOADED, loaded.text))
        if self._guarded and not self.guarded:
            self._guarded = self.taken_over = False
            text = f"no beat of the guardian for {1000 * GONE_S:.0f} ms"
            self.report(Event(Kind.UNGUARDED, text))


def _named(can_id: int) -> str:
    return f"0x{can_id & IDENTIFIER:03X}"
