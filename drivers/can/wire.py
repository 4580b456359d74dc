"""Frames in and out of an open bus at the cost of the tick.

A frame is (can_id, data), can_id with Linux' flags above the identifier, so that one look-up tells
a TPDO from everything else. python-can builds an object and asks the kernel several times for every
frame; where the bus is a socket or a queue, the wire reads and writes that itself. A wire never
blocks on sending, and raises one of `BUS_FAILURES` when the bus fails.
"""

import os
import queue
import re
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Protocol

import can
from can.interfaces.virtual import VirtualBus

from drivers.can.bus import socketcand_socket

EXTENDED: Final = 0x8000_0000
REMOTE: Final = 0x4000_0000
ERROR: Final = 0x2000_0000

Frame = tuple[int, bytes | bytearray]


class Wire(Protocol):
    """What a tick needs of a bus."""

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, waiting at most `timeout` s (0: not at all); None if none came."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames with 11-bit identifiers, in order; the first failure ends it."""


def open_wire(bus: can.BusABC) -> Wire:
    """The cheapest wire to an open bus, which has no other reader from now on."""
    stream = socketcand_socket(bus)
    if stream is not None:
        return StreamWire(stream)
    raw = getattr(bus, "socket", None)
    if isinstance(raw, socket.socket):
        return RawWire(raw)
    port = getattr(bus, "serialPortOrig", None)
    if port is not None:
        return SlcanWire(port.fileno())
    if isinstance(bus, VirtualBus):
        return QueueWire(bus)
    return MessageWire(bus)


class MessageWire:
    """Any bus of python-can."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def receive(self, timeout: float) -> Frame | None:
        message = self._bus.recv(timeout)
        return None if message is None else frame_of(message)

    def send(self, frames: Sequence[Frame]) -> None:
        for can_id, data in frames:
            self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


class QueueWire:
    """python-can's virtual bus: a queue per end. Reading takes all that is queued under one lock;
    writing gives each other end messages of its own."""

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
                    # A copy: the data of a setpoint is written anew by the next command.
                    end.put_nowait(
                        can.Message(
                            now, i, is_extended_id=False, channel=name, data=bytearray(data)
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


def frame_of(message: can.Message) -> Frame:
    """What python-can received, with Linux' flags in the identifier."""
    can_id = message.arbitration_id
    if message.is_error_frame:
        can_id |= ERROR
    if message.is_extended_id:
        can_id |= EXTENDED
    if message.is_remote_frame:
        can_id |= REMOTE
    return can_id, message.data


class RawWire:
    """Linux' CAN_RAW socket: a read is a frame (struct can_frame of linux/can.h)."""

    _LAYOUT: Final = struct.Struct("=IB3x8s")

    def __init__(self, raw: socket.socket) -> None:
        self._socket = raw

    def receive(self, timeout: float) -> Frame | None:
        # Of the answers to one SYNC most are there already: reading first spares the waiting.
        frame = self._read()
        if frame is None and timeout > 0.0 and select.select([self._socket], [], [], timeout)[0]:
            frame = self._read()
        return frame

    def send(self, frames: Sequence[Frame]) -> None:
        for can_id, data in frames:
            frame = self._LAYOUT.pack(can_id, len(data), data)
            self._socket.send(frame, socket.MSG_DONTWAIT)

    def _read(self) -> Frame | None:
        try:
            frame = self._socket.recv(self._LAYOUT.size, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        can_id, size, data = self._LAYOUT.unpack(frame)
        return can_id, data[:size]


def _first(
    frames: deque[Frame], port: socket.socket | int, read: Callable[[], None], timeout: float
) -> Frame | None:
    """The first of `frames`, which `read` fills from `port`. What comes may be a piece of a frame,
    or an adapter's word on what it was sent: the whole timeout is waited for a frame."""
    left, deadline = timeout, time.monotonic() + timeout
    while not frames:
        # Not only to wait: a line that has nothing to say reads like one that has ended.
        if not select.select([port], [], [], max(left, 0.0))[0]:
            return None
        read()
        left = deadline - time.monotonic()
        if left <= 0.0:
            break
    return frames.popleft() if frames else None


class StreamWire:
    """socketcand's raw mode over TCP: text, any number of frames in a read."""

    _FRAME: Final = re.compile(
        rb"< (frame|error) ([0-9A-Fa-f]+) [0-9.]+ ?((?:[0-9A-Fa-f]{2})*) ?[^<>]*>"
    )
    _READ_SIZE: Final = 16_384

    def __init__(self, stream: socket.socket) -> None:
        self._socket = stream
        self._queue: deque[Frame] = deque()
        self._rest = b""

    def receive(self, timeout: float) -> Frame | None:
        return _first(self._queue, self._socket, self._read, timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        text = "".join(
            f"< send {can_id:03X} {len(data):X} {data.hex(' ')} >" for can_id, data in frames
        ).encode()
        if self._socket.send(text, socket.MSG_DONTWAIT) != len(text):
            # What follows would be read as the end of the frame that was cut.
            self._socket.shutdown(socket.SHUT_RDWR)
            raise ConnectionError("the peer does not keep up; connection closed")

    def _read(self) -> None:
        try:
            text = self._socket.recv(self._READ_SIZE, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        if not text:
            raise ConnectionError("the peer has closed the connection")
        text = self._rest + text
        end = 0
        for match in self._FRAME.finditer(text):
            kind, identifier, data = match.groups()
            can_id = int(identifier, 16)
            if kind == b"error":
                can_id = can_id & 0x1FFF_FFFF | ERROR
            elif len(identifier) != 3:
                can_id |= EXTENDED
            self._queue.append((can_id, bytes.fromhex(data.decode())))
            end = match.end()
        # A frame may be cut in two; what is no frame at all must not pile up.
        self._rest = text[end:][-64:]


class SlcanWire:
    """slcan over a serial line that was opened without waiting: text, a frame per line."""

    _LINE: Final = re.compile(rb"([tTrR])([0-9A-Fa-f]+)\r")
    _READ_SIZE: Final = 4096

    def __init__(self, port: int) -> None:
        """`port`: file descriptor of the line."""
        self._port = port
        self._queue: deque[Frame] = deque()
        self._rest = b""
        self._unsent = b""

    def receive(self, timeout: float) -> Frame | None:
        return _first(self._queue, self._port, self._read, timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        if self._unsent:
            self._unsent = self._unsent[os.write(self._port, self._unsent) :]
        text = b"".join(
            b"t%03X%d%s\r" % (can_id, len(data), data.hex().encode()) for can_id, data in frames
        )
        sent = 0 if self._unsent else os.write(self._port, text)
        if sent != len(text):
            # The frame that was cut has to be completed; the others would be old by then.
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
        # A line may be cut in two; what is none at all must not pile up.
        self._rest = text[end:][-64:]


def _slcan_frame(kind: bytes, digits: bytes) -> Frame | None:
    """`t` or `r` with three digits of identifier, `T` or `R` with eight; then length and data.

    None for a line that is garbled; what follows the data is a time stamp.
    """
    width = 3 if kind in b"tr" else 8
    size = int(digits[width : width + 1] or b"F", 16)
    remote = kind in b"rR"
    data = b"" if remote else digits[width + 1 : width + 1 + 2 * size]
    if size > 8 or (not remote and len(data) != 2 * size):
        return None
    can_id = int(digits[:width], 16) & 0x1FFF_FFFF
    can_id |= (REMOTE if remote else 0) | (EXTENDED if width == 8 else 0)
    return can_id, bytes.fromhex(data.decode())
