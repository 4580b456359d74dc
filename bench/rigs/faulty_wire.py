"""Wire that can be broken: it loses frames, and raises what the real one raises."""

import errno
import os
from collections import deque
from collections.abc import Callable, Sequence

from drivers.can.wire import Frame, Wire

QUEUED = 10  # What a network interface queues by default (txqueuelen)


class FaultyWire:
    """Stands between the drives of the daemon and the wire that they would have."""

    def __init__(self, wire: Wire, kin: Callable[[int], int] = lambda can_id: can_id) -> None:
        """kin: identifier by which a frame is known here."""
        self._wire, self._kin = wire, kin
        self.lost: set[int] = set()
        self.changes: list[Callable[[int, bytes], bytes]] = []  # of received data, one by one
        self.unsent: set[int] = set()  # Frames of ours that get lost.
        self.late: set[int] = set()  # Frames that come when `pass_tick` is called.
        self.twice: set[int] = set()  # Frames that come twice.
        self._held: list[Frame] = []
        self._ready: deque[Frame] = deque()
        self.queue: list[Frame] | None = None
        """Queue in which frames of ours wait for a bus that is off; None while it is not."""
        self.sending: Exception | None = None
        self.receiving: Exception | None = None
        self.sent: list[tuple[int, bytes]] = []  # Since the last tick began.

    def receive(self, timeout: float) -> Frame | None:
        """The next frame that is not lost, like `Wire.receive`."""
        if self.receiving:
            raise self.receiving
        while frame := self._ready.popleft() if self._ready else self._next(timeout):
            if self._kin(frame[0]) not in self.lost:
                return self._changed(*frame) if self.changes else frame
        return None

    def _next(self, timeout: float) -> Frame | None:
        """The next frame that is not late, from the wire."""
        while frame := self._wire.receive(timeout):
            kin = self._kin(frame[0])
            if kin in self.twice:
                self._ready.append(frame)
            if kin not in self.late:
                return frame
            self._held.append(frame)
        return None

    def pass_tick(self) -> None:
        """Let the frames come that were late in the tick before."""
        self._ready += self._held
        self._held.clear()

    def _changed(self, can_id: int, data: bytes | bytearray) -> Frame:
        for change in self.changes:
            data = change(can_id, bytes(data))
        return can_id, data

    def send(self, frames: Sequence[Frame]) -> None:
        """Send, or raise what was put in the way, like `Wire.send`."""
        if self.sending:
            raise self.sending
        kept = [(i, bytes(data)) for i, data in frames if self._kin(i) not in self.unsent]
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
