"""Wire that can be broken: it loses frames, and raises what the real one raises."""

from collections.abc import Sequence

from drivers.can.wire import Frame, Wire


class FaultyWire:
    """Stands between the drives of the daemon and the wire that they would have."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.lost: set[int] = set()
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
        self.sent += [(can_id, bytes(data)) for can_id, data in frames]
        self._wire.send(frames)
