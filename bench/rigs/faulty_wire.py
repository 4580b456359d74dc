"""Wire that can be broken: it loses frames, and raises what the real one raises."""

import errno
import os
from collections.abc import Sequence

from drivers.can.wire import Frame, Wire

#: What a network interface queues by default (txqueuelen).
QUEUED = 10


class FaultyWire:
    """Stands between the drives of the daemon and the wire that they would have."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.lost: set[int] = set()
        self.unsent: set[int] = set()
        """Frames of ours that get lost."""
        self.queue: list[Frame] | None = None
        """Where frames of ours wait for a bus that is off; None while it is not."""
        self.sending: Exception | None = None
        self.receiving: Exception | None = None
        self.sent: list[tuple[int, bytes]] = []
        """Since the last tick began."""

    def receive(self, timeout: float) -> Frame | None:
        """The next frame that is not lost, like `Wire.receive`."""
        if self.receiving:
            raise self.receiving
        while (frame := self._wire.receive(timeout)) is not None:
            if frame[0] not in self.lost:
                return frame
        return None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send, or raise what was put in the way, like `Wire.send`."""
        if self.sending:
            raise self.sending
        kept = [(can_id, bytes(data)) for can_id, data in frames if can_id not in self.unsent]
        if self.queue is not None:
            room = QUEUED - len(self.queue)
            self.queue += kept[:room]
            if len(kept) > room:
                raise OSError(errno.ENOBUFS, os.strerror(errno.ENOBUFS))
            return
        self.sent += kept
        self._wire.send(kept)

    def flush(self) -> None:
        """The bus is back, and takes what waited."""
        waiting, self.queue = self.queue or [], None
        self._wire.send(waiting)
