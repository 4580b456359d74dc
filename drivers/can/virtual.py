"""virtual: python-can's bus within one process, for benches, tests and in-process simulation."""

import queue
import time
from collections import deque
from collections.abc import Sequence
from typing import cast

import can
from can.interfaces.virtual import VirtualBus

from drivers.can.settings import BusSettings
from drivers.can.wire import EXTENDED, IDENTIFIER, Frame, OpenBus, frame_of


def open_virtual(settings: BusSettings) -> OpenBus:
    """Open another end of the bus with this channel name in this process."""
    return open_end(cast(VirtualBus, can.Bus(interface="virtual", channel=settings.channel)))


def open_end(bus: VirtualBus) -> OpenBus:
    """Wrap an existing end as an open bus."""
    return OpenBus(bus, QueueWire(bus))


class QueueWire:
    """python-can's virtual bus: one queue per end. A read drains the queue under one lock; a write
    puts separate message objects into the queue of each other end."""

    def __init__(self, bus: VirtualBus) -> None:
        self._own, self._ends = bus.queue, bus.channel
        self._name = bus.channel_id
        self._taken: deque[can.Message] = deque()

    def receive(self, timeout: float) -> Frame | None:
        if not self._taken and not self._take(timeout):
            return None
        return frame_of(self._taken.popleft())

    def send(self, frames: Sequence[Frame]) -> None:
        self._refuse_closed()
        now, name = time.time(), self._name
        for end in self._ends:
            if end is self._own:
                continue
            try:
                for i, data in frames:
                    # A copy: the next command overwrites the data of a setpoint in place.
                    end.put_nowait(
                        can.Message(
                            now, i & IDENTIFIER, i >= EXTENDED, channel=name, data=bytearray(data)
                        )
                    )
            except queue.Full:
                raise can.CanOperationError("the other end does not keep up") from None

    def _take(self, timeout: float) -> bool:
        own = self._own
        with own.mutex:
            if not own.queue:
                self._refuse_closed()
                if timeout <= 0.0 or not own.not_empty.wait_for(lambda: own.queue, timeout):
                    return False
            self._taken.extend(own.queue)
            own.queue.clear()
            own.not_full.notify_all()
        return True

    def _refuse_closed(self) -> None:
        if self._own not in self._ends:
            raise can.CanOperationError("cannot operate on a closed bus")
