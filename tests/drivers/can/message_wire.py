"""Wire over any bus of python-can, by its own calls: what the wires of `drivers.can` spare."""

from collections.abc import Sequence

import can

from drivers.can.wire import Frame, frame_of


class MessageWire:
    """A bus of which nothing is known but `recv` and `send`."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, like `Wire.receive`."""
        message = self._bus.recv(timeout)
        return None if message is None else frame_of(message)

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames one by one, like `Wire.send`."""
        for can_id, data in frames:
            self._bus.send(
                can.Message(
                    arbitration_id=can_id & 0x1FFFFFFF, data=data, is_extended_id=can_id > 0x7FF
                )
            )
