"""canopen's network over the wire of the tick, for the duration of SDO transfers.

Tick and SDO take turns on one bus. Both read it through the same wire, which alone buffers bytes
that are read but not yet returned: a partial frame is completed in the other's turn, and an unread
frame goes to the next reader.
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
from drivers.canopen.boot.received_frames import ReceivedFrames

# Failures are raised, and reported where they are caught; canopen would log them again.
logging.getLogger("canopen").setLevel(logging.CRITICAL)

_READER_CYCLE_S: Final = 0.02
_HIGHEST_ID: Final = 0x7FF


class SdoNetwork(canopen.Network):  # type: ignore[misc]
    """canopen's network over a wire, with a reader thread.

    `ring` records the frames of both directions; `received` keeps all incoming ones."""

    def __init__(
        self, wire: Wire, ring: FrameRing | None = None, received: ReceivedFrames | None = None
    ) -> None:
        super().__init__()
        self._wire, self._ring, self._received = wire, ring, received
        self._ring_alone = threading.Lock()
        self._failure: Exception | None = None
        self._ended = threading.Event()
        self._reader = threading.Thread(target=self._read, name="SDO reader", daemon=True)

    def start(self) -> None:
        """Start reading, beginning with queued frames."""
        self._reader.start()

    def stop(self) -> None:
        """Stop reading after the current frame; later frames stay in the wire."""
        self._ended.set()
        self._reader.join()

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame. Raises one of BUS_FAILURES, or BusError once the reader has failed. A frame
        that the bus refuses is not recorded."""
        assert not remote, "a wire sends no remote frames"
        frame = can_id, bytes(data)
        self._wire.send([frame])
        self._keep(frame, sent=True)
        self.check()

    def check(self) -> None:
        """Raise BusError if the reader has failed: no drive is heard any more."""
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
        # Recorded before delivery, as its receiver may then send the next frame.
        self._keep(frame, sent=False)
        if self._received is not None:
            self._received.put(frame)
        can_id, data = frame
        if can_id <= _HIGHEST_ID:
            self.notify(can_id, data, 0.0)

    def _keep(self, frame: Frame, *, sent: bool) -> None:
        if self._ring is not None:
            # The ring allows one writer at a time; a lock is permitted outside the tick.
            with self._ring_alone:
                self._ring.put(self._ring.clock(), *frame, sent)


@contextmanager
def sdo_network(
    wire: Wire, ring: FrameRing | None = None, received: ReceivedFrames | None = None
) -> Iterator[SdoNetwork]:
    """`SdoNetwork` that reads within the block. Leaving the block raises BusError if the reader has
    failed and nothing else was raised."""
    network = SdoNetwork(wire, ring, received)
    network.start()
    try:
        yield network
    finally:
        network.stop()
    network.check()
