"""Blocking requests to motors, one at a time: for set-up, never within a tick.

Answers carry no sequence number, so the receive queue is drained before each request.
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
#: Relative and absolute tolerance of a value read back, which has 24 bits.
SAME: Final = 1e-6
#: Longest time between two calls of `meanwhile` [s].
SLICE_S: Final = 0.005
#: Frames drained before a request; more is a flooded bus.
_QUEUED: Final = 2000

T = TypeVar("T")
Answer = Callable[[int, bytes | bytearray], T | None]
"""Decoder of a frame; returns None if it is not the answer."""


@dataclass(frozen=True, slots=True)
class Queries:
    """Requests on one wire. `meanwhile` is called at least every SLICE_S."""

    wire: Wire
    meanwhile: Callable[[], None] = lambda: None
    clock: Callable[[], float] = time.monotonic

    def ask(self, question: Frame, answer: Answer[T], timeout_s: float) -> T | None:
        """Decoded answer to a request; None after three unanswered requests. Raises BusError."""
        for _ in range(TRIES):
            try:
                for _ in range(_QUEUED):
                    if self.wire.receive(0.0) is None:
                        break
                self.wire.send([question])
                for frame in received_frames(self.wire, timeout_s, self.meanwhile, self.clock):
                    if (found := answer(*frame)) is not None:
                        return found
            except BUS_FAILURES as error:
                raise BusError(f"the bus fails: {error}") from error
        return None


def received_frames(
    wire: Wire,
    seconds: float,
    meanwhile: Callable[[], None] = lambda: None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Frame]:
    """Frames of the next `seconds`, then those already queued: a busy machine may delay this
    process, but not the motor's answer."""
    deadline, late = clock() + seconds, _QUEUED
    while (left := deadline - clock()) > 0.0 or late:
        meanwhile()
        frame = wire.receive(min(max(left, 0.0), SLICE_S))
        if frame is not None:
            yield frame
        if left <= 0.0:
            late = late - 1 if frame is not None else 0


def same(held: float, wanted: float) -> bool:
    """True if a motor holds the wanted value, up to rounding."""
    return math.isclose(held, wanted, rel_tol=SAME, abs_tol=SAME)
