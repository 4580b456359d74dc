"""canopen's network over the wire of the tick, for the duration of SDO transfers.

Tick and SDO take turns on one bus. Both read it through the same wire, which alone keeps the bytes
that it has read and not handed out: a frame that came half in one's turn is whole in the other's,
and an unread one goes to the next reader, at once.
"""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import canopen

from common.errors import BusError
from drivers.can.frame_ring import FrameRing
from drivers.can.wire import Frame, Wire
from drivers.canopen.boot.heard_frames import HeardFrames

# Failures are raised, and reported where they are caught; canopen would log them once more.
logging.getLogger("canopen").setLevel(logging.CRITICAL)

_READER_CYCLE_S: Final = 0.02
_HIGHEST_ID: Final = 0x7FF


class SdoNetwork(canopen.Network):  # type: ignore[misc]
    """canopen's network, sending and read by a wire, in a thread of its own.

    `ring` keeps the frames of both directions, `heard` gets all that come."""

    def __init__(
        self, wire: Wire, ring: FrameRing | None = None, heard: HeardFrames | None = None
    ) -> None:
        super().__init__()
        self._wire, self._ring, self._heard = wire, ring, heard
        self._ring_alone = threading.Lock()
        self._failure: Exception | None = None
        self._ended = threading.Event()
        self._reader = threading.Thread(target=self._read, name="SDO reader", daemon=True)

    def start(self) -> None:
        """Begin to read; what is queued comes first."""
        self._reader.start()

    def stop(self) -> None:
        """End reading, after the frame that is being read; the next stays in the wire."""
        self._ended.set()
        self._reader.join()

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame; raises one of BUS_FAILURES, or BusError once the reader has failed. A frame
        that the bus refuses is not kept."""
        assert not remote, "a wire sends no remote frames"
        frame = can_id, bytes(data)
        self._wire.send([frame])
        self._keep(frame, sent=True)
        self.check()

    def check(self) -> None:
        """Raise BusError once the reader has failed: from then on no drive is heard."""
        if self._failure is not None:
            raise BusError(f"the bus can no longer be read: {self._failure}") from self._failure

    def _read(self) -> None:
        try:
            while not self._ended.is_set():
                frame = self._wire.receive(_READER_CYCLE_S)
                if frame is not None:
                    self._hear(frame)
        except Exception as error:  # raised again by `check`, in the thread that waits for answers
            self._failure = error

    def _hear(self, frame: Frame) -> None:
        # Kept first: once it is delivered, its receiver may send the next.
        self._keep(frame, sent=False)
        if self._heard is not None:
            self._heard.put(frame)
        can_id, data = frame
        if can_id <= _HIGHEST_ID:
            self.notify(can_id, data, 0.0)

    def _keep(self, frame: Frame, *, sent: bool) -> None:
        if self._ring is not None:
            # Outside the tick, where one may wait: the ring has one writer at a time.
            with self._ring_alone:
                self._ring.put(self._ring.clock(), *frame, sent)


@contextmanager
def sdo_network(
    wire: Wire, ring: FrameRing | None = None, heard: HeardFrames | None = None
) -> Iterator[SdoNetwork]:
    """An `SdoNetwork` that is read inside the block. Leaving it raises BusError if the reader has
    failed meanwhile and nothing else was raised."""
    network = SdoNetwork(wire, ring, heard)
    network.start()
    try:
        yield network
    finally:
        network.stop()
    network.check()
