"""Ends of a line in lockstep whose frames take their time: each waits for what the other sent."""

import os
import select
from collections import deque
from collections.abc import Callable, Sequence

import can

from drivers.can.wire import Frame, Wire

TIMEOUT_S = 20.0  # with this machine: whatever is waited for so long is lost
READ_SIZE = 65_536
MARK = 0x7FF  # an identifier that is not used


class InterfaceEnd:
    """The drives' end of a CAN interface."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.to_daemon = self.to_drives = 0  # Frames on their way.

    def send(self, msg: can.Message) -> None:
        self._bus.send(msg)
        self.to_daemon += 1

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = self._bus.recv(TIMEOUT_S if self.to_drives else timeout)
        assert message or not self.to_drives, "the daemon's frames are lost on the line"
        self.to_drives = max(self.to_drives - 1, 0)
        return message


class TextEnd:
    """The drives' end of a line of text."""

    def __init__(
        self,
        port: int,
        encode: Callable[[can.Message], bytes],
        decode: Callable[[bytes], list[can.Message]],
    ) -> None:
        self._port: int | None = port
        self._encode, self._decode = encode, decode
        self._heard: deque[can.Message] = deque()
        self.to_daemon = self.to_drives = 0  # Frames on their way.

    def send(self, msg: can.Message) -> None:
        if self._port is None:
            return
        text = self._encode(msg)
        while text:
            text = text[os.write(self._port, text) :]
        self.to_daemon += 1

    def recv(self, timeout: float | None = None) -> can.Message | None:
        while not self._heard:
            if self._port is None:
                return None
            wait = TIMEOUT_S if self.to_drives else timeout
            if not select.select([self._port], [], [], wait)[0]:
                assert not self.to_drives, "the daemon's frames are lost on the line"
                return None
            self._heard += self._decode(os.read(self._port, READ_SIZE))
        self.to_drives = max(self.to_drives - 1, 0)
        return self._heard.popleft()

    def unplug(self) -> None:
        if self._port is not None:
            os.close(self._port)
            self._port = None
            self.to_daemon = self.to_drives = 0


class PatientWire:
    """The daemon's wire of such a line, to which frames can be given back."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._back: deque[Frame] = deque()

    def receive(self, timeout: float) -> Frame | None:
        return self._back.popleft() if self._back else self._wire.receive(timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        self._wire.send(frames)

    def take_in(self) -> int:
        """Read up to the other end's mark, and give back what came before; how many those are."""
        came: list[Frame] = []
        while True:
            frame = self.receive(TIMEOUT_S)
            assert frame is not None, "the drives' mark is lost on the line"
            if frame[0] == MARK:
                self._back.extend(came)
                return len(came)
            came.append(frame)


class AwaitedWire:
    """The same, which waits for what is on its way."""

    def __init__(self, wire: Wire, far: TextEnd | InterfaceEnd) -> None:
        self._wire, self._far = wire, far

    def receive(self, timeout: float) -> Frame | None:
        frame = self._wire.receive(timeout)
        if frame is None and self._far.to_daemon:
            frame = self._wire.receive(TIMEOUT_S)
            assert frame is not None, "the drives' frames are lost on the line"
        if frame is not None:
            self._far.to_daemon = max(self._far.to_daemon - 1, 0)
        return frame

    def send(self, frames: Sequence[Frame]) -> None:
        self._wire.send(frames)
        self._far.to_drives += len(frames)
