"""slcan: a CAN adapter on a serial line, with each frame as a line of text."""

import os
import re
from collections import deque
from collections.abc import Sequence
from typing import Final

import can

from drivers.can.settings import BusSettings
from drivers.can.wire import EXTENDED, IDENTIFIER, REMOTE, Frame, OpenBus, digits_of, first_of


def open_slcan(settings: BusSettings) -> OpenBus:
    """Open the adapter on a serial line, at the configured bitrate."""
    bus = can.Bus(interface="slcan", channel=settings.channel, bitrate=settings.bitrate)
    port = bus.serialPortOrig.fileno()  # type: ignore[attr-defined]  # of slcanBus
    return OpenBus(bus, SlcanWire(port))


class SlcanWire:
    """slcan over a serial line opened in non-blocking mode: text, one frame per line."""

    _LINE: Final = re.compile(rb"([tTrR])([0-9A-Fa-f]+)\r")
    _READ_SIZE: Final = 4096

    def __init__(self, port: int) -> None:
        """`port`: file descriptor of the line."""
        self._port = port
        self._queue: deque[Frame] = deque()
        self._rest = b""
        self._unsent = b""

    def receive(self, timeout: float) -> Frame | None:
        return first_of(self._queue, self._port, self._read, timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        if self._unsent:
            self._unsent = self._unsent[os.write(self._port, self._unsent) :]
        text = b"".join(
            b"%c%s%d%s\r"
            % (b"tT"[can_id >= EXTENDED], digits_of(can_id), len(data), data.hex().encode())
            for can_id, data in frames
        )
        sent = 0 if self._unsent else os.write(self._port, text)
        if sent != len(text):
            # The truncated frame has to be completed; the others would be outdated by then.
            self._unsent = self._unsent or text[sent : text.find(b"\r", sent) + 1]
            raise can.CanOperationError("the adapter does not keep up")

    def _read(self) -> None:
        text = os.read(self._port, self._READ_SIZE)
        if not text:
            raise ConnectionError("the adapter is gone")
        text = self._rest + text
        end = 0
        for match in self._LINE.finditer(text):
            kind, digits = match.groups()
            frame = _slcan_frame(kind, digits)
            if frame is not None:
                self._queue.append(frame)
            end = match.end()
        # A read may end within a line; garbage must not accumulate.
        self._rest = text[end:][-64:]


def _slcan_frame(kind: bytes, digits: bytes) -> Frame | None:
    """Frame of one line: `t` or `r` and a three-digit identifier, or `T` or `R` and an eight-digit
    one; then length, data and an optional time stamp.

    None if the line is garbled or encodes an impossible frame."""
    width = 3 if kind in b"tr" else 8
    size = int(digits[width : width + 1] or b"F", 16)
    remote = kind in b"rR"
    data = b"" if remote else digits[width + 1 : width + 1 + 2 * size]
    if size > 8 or (not remote and len(data) != 2 * size):
        return None
    can_id = int(digits[:width], 16)
    if can_id > (0x7FF if width == 3 else IDENTIFIER):
        return None
    can_id |= (REMOTE if remote else 0) | (EXTENDED if width == 8 else 0)
    return can_id, bytes.fromhex(data.decode())
