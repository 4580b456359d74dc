"""Questions to motors over the wire, one at a time: for set-up, never in a tick.

Answers carry neither a number nor a time, so that the queue is emptied before each question.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

from common.errors import BusError
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Frame, Wire

TRIES: Final = 3
#: A float that was set reads the same but for its 24 bits.
SAME: Final = 1e-6
#: Of a wait, between two calls of `meanwhile` [s].
SLICE_S: Final = 0.005
#: Frames that may be queued before a question; more is a flood.
_QUEUED: Final = 2000

T = TypeVar("T")
Answer = Callable[[int, bytes | bytearray], T | None]
"""Contents of a frame; None for any that is no answer."""


@dataclass(frozen=True, slots=True)
class Queries:
    """Questions on one wire. `meanwhile` is called at least every SLICE_S."""

    wire: Wire
    meanwhile: Callable[[], None] = lambda: None
    clock: Callable[[], float] = time.monotonic

    def ask(self, question: Frame, answer: Answer[T], timeout_s: float) -> T | None:
        """First frame that is an `answer`, as it is taken; None after three questions without one.
        Raises BusError."""
        for _ in range(TRIES):
            try:
                for _ in range(_QUEUED):
                    if self.wire.receive(0.0) is None:
                        break
                self.wire.send([question])
                for frame in heard(self.wire, timeout_s, self.meanwhile, self.clock):
                    if (found := answer(*frame)) is not None:
                        return found
            except BUS_FAILURES as error:
                raise BusError(f"the bus fails: {error}") from error
        return None


def heard(
    wire: Wire,
    seconds: float,
    meanwhile: Callable[[], None] = lambda: None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Frame]:
    """Frames of the next seconds, and then those that are here already: a busy machine may hold up
    who asks, not the motor."""
    deadline, late = clock() + seconds, _QUEUED
    while (left := deadline - clock()) > 0.0 or late:
        meanwhile()
        frame = wire.receive(min(max(left, 0.0), SLICE_S))
        if frame is not None:
            yield frame
        if left <= 0.0:
            late = late - 1 if frame is not None else 0


def same(held: float, wanted: float) -> bool:
    """True if a motor holds what it should."""
    return math.isclose(held, wanted, rel_tol=SAME, abs_tol=SAME)
