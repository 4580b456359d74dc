"""A bus that can be broken: it loses frames, adds frames, and raises what python-can raises."""

import can


class FaultyBus:
    """Stands between the daemon and its bus."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.lost: set[int] = set()
        self.added: list[can.Message] = []
        self.sending: Exception | None = None
        self.receiving: Exception | None = None
        self.sent: list[tuple[int, bytes]] = []
        """Since the last tick began."""

    @property
    def channel_info(self) -> str:
        """For error messages."""
        return f"faulty {self._bus.channel_info}"

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As BusABC.recv."""
        if self.receiving:
            raise self.receiving
        if self.added:
            return self.added.pop(0)
        while (message := self._bus.recv(timeout)) is not None:
            if message.arbitration_id not in self.lost:
                return message
        return None

    def send(self, message: can.Message) -> None:
        """As BusABC.send."""
        if self.sending:
            raise self.sending
        self.sent.append((message.arbitration_id, bytes(message.data)))
        self._bus.send(message)

    def add(self, cob_id: int, data: bytes = b"", **kind: bool) -> None:
        """Let a frame of somebody else arrive before the next SYNC."""
        message = can.Message(
            arbitration_id=cob_id, data=data, **({"is_extended_id": False} | kind)
        )
        self.added.append(message)
