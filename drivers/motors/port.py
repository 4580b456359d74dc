"""Port of an arm to its bus: incoming and outgoing frames, and their events. Bus failures are
reported as events, not raised.
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
from drivers.motors.guardian import BEAT, GONE_S, Activity
from drivers.motors.language import Language
from drivers.motors.replies import Replies

#: Bound per pass: a flooded bus must not block the loop.
FRAMES_PER_PASS: Final = 512


class Port:
    """Port that feeds `Replies`; only this master and a guardian may command the motors."""

    def __init__(
        self,
        wire: Wire,
        replies: Replies,
        traffic: Traffic,
        language: Language,
        on_bus_off: Callable[[], None],
        on_held: Callable[[int, float], None],
    ) -> None:
        """on_held: called with a joint and the position at which the guardian holds it [rad]."""
        self._wire, self._replies, self._traffic = wire, replies, traffic
        self._language = language
        self._on_bus_off, self._on_held = on_bus_off, on_held
        events: EventQueue[Event] = EventQueue()
        self.report, self.events = events.report, events.take
        self.now = 0.0
        """Time of the tick [s]."""
        self._beat_s = -math.inf  # of the guardian
        self._guarded = self.taken_over = False
        """True while a guardian holds motors."""
        self._begun_s = 0.0
        self.zeroed: set[int] = set()
        """Joints whose motors were given a new zero by another master."""

    def begin(self, now: float) -> None:
        """Start cyclic operation."""
        self.now = self._begun_s = now
        self._traffic.begin(now, self._replies.late_frames)
        if self.taken_over:  # heard during boot-up
            self._beat_s, self._guarded = now, True

    def send(self, frames: Sequence[Frame]) -> bool:
        """Send frames; False, with an event, if the bus does not accept all of them."""
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self.report(bus_failure("sending", error))
            return False
        return True

    def take_next(self, timeout: float) -> bool:
        """Take the next frame, waiting at most `timeout` s; False on timeout or bus failure."""
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
        """Take the queued frames; False if there may be more than one pass reads."""
        return not all(self.take_next(0.0) for _ in range(FRAMES_PER_PASS))

    def _take(self, can_id: int, data: bytes | bytearray) -> None:
        language = self._language
        if (joint := language.answering(can_id)) is not None:
            if not self._replies.take(joint, can_id, data):
                text = f"an implausible answer under {_named(can_id)} was discarded"
                self.report(Event(Kind.DISTURBED, text))
            return
        if can_id & ERROR:
            event = error_frame(can_id & ~ERROR, data)
            if event.kind is Kind.OFF_BUS:
                self._on_bus_off()
            self.report(event)
            return
        if (joint := language.zeroed(can_id)) is not None:
            self._replies.forget(joint)  # the old p would make it jump
            self._on_held(joint, math.nan)
            self.zeroed.add(joint)
        joint = language.commanded(can_id)
        self._traffic.take(can_id, len(data), unknown=joint is None and can_id != BEAT)
        if can_id == BEAT and len(data):
            self._beat_s, self._guarded = self.now, True
            self.taken_over = data[0] != Activity.WATCHES
        elif joint is not None and self.taken_over:
            if (found := language.setpoint_of(joint, can_id, data)) is not None:
                self._on_held(joint, found[0])
            if self.now - self._begun_s > GONE_S:  # at the start this is no event
                self.report(Event(Kind.ABSENT, "the guardian held the arm meanwhile"))
        elif language.masters(can_id):
            self.report(Event(Kind.FOREIGN_MASTER, f"it sends {_named(can_id)}"))

    @property
    def guarded(self) -> bool:
        """True while a guardian is heard."""
        return self.now - self._beat_s <= GONE_S

    def end_tick(self) -> None:
        """Report an overloaded bus, and once a guardian that is gone."""
        self._traffic.step(self.now, self._replies.late_frames)
        if loaded := self._traffic.loaded:
            self.report(Event(Kind.LOADED, loaded.text))
        if self._guarded and not self.guarded:
            self._guarded = self.taken_over = False
            text = f"no heartbeat of the guardian for {1000 * GONE_S:.0f} ms"
            self.report(Event(Kind.UNGUARDED, text))


def _named(can_id: int) -> str:
    return f"0x{can_id & IDENTIFIER:03X}"
