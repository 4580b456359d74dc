"""socketcand: a CAN bus over TCP, each frame a piece of text."""

import re
import socket
from collections import deque
from collections.abc import Sequence
from typing import Final

import can

from common.errors import BusError
from drivers.can.settings import BusSettings
from drivers.can.wire import ERROR, EXTENDED, IDENTIFIER, Frame, OpenBus, digits_of, first_of

_CONNECT_TIMEOUT_S: Final = 2.0


def open_socketcand(settings: BusSettings) -> OpenBus:
    """Open a bus that a server has; raises BusError if there is none, or not this bus."""
    _refuse_missing_server(settings)
    bus = can.Bus(
        interface="socketcand",
        host=settings.host,
        port=settings.port,
        channel=settings.channel,
        tcp_tune=True,
    )
    # python-can keeps its connection to itself.
    stream = getattr(bus, "_SocketCanDaemonBus__socket", None)
    if not isinstance(stream, socket.socket):
        bus.shutdown()
        raise BusError(f"bus socketcand: python-can {can.__version__} hides its connection")
    return OpenBus(bus, StreamWire(stream))


def _refuse_missing_server(settings: BusSettings) -> None:
    where = f"{settings.host}:{settings.port}"
    # python-can would retry a refused connection for ten seconds, wait for a greeting for ever, and
    # leave its socket open after a refusal; so a connection of our own tries first.
    try:
        with socket.create_connection((settings.host, settings.port), _CONNECT_TIMEOUT_S) as probe:
            greeting = probe.recv(64)
            if greeting != b"< hi >":
                raise BusError(f"bus socketcand: {where} answers, but not as socketcand does")
            probe.sendall(f"< open {settings.channel} >".encode())
            answer = probe.recv(256)
            if answer != b"< ok >":
                words = answer.decode(errors="replace")
                raise BusError(f"bus socketcand: {where} opens no {settings.channel!r}: {words!r}")
    except ConnectionRefusedError as error:
        raise BusError(
            f"bus socketcand: nothing listens on {where}; is `contactd simulate` running?"
        ) from error
    except OSError as error:
        raise BusError(f"bus socketcand: {where}: {error}") from error


class StreamWire:
    """socketcand's raw mode over TCP: text, any number of frames in a read."""

    # Data may be followed by what other versions add, but not by more data.
    _FRAME: Final = re.compile(
        rb"< (frame|error) ([0-9A-Fa-f]+) [0-9.]+ ?([0-9A-Fa-f]*)(?: [^<>]*)?>"
    )
    _READ_SIZE: Final = 16_384

    def __init__(self, stream: socket.socket) -> None:
        self._socket = stream
        self._queue: deque[Frame] = deque()
        self._rest = b""

    def receive(self, timeout: float) -> Frame | None:
        return first_of(self._queue, self._socket, self._read, timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        text = b"".join(
            b"< send %s %X %s >" % (digits_of(can_id), len(data), data.hex(" ").encode())
            for can_id, data in frames
        )
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
            frame = _socketcand_frame(*match.groups())
            if frame is not None:
                self._queue.append(frame)
            end = match.end()
        # A frame may be cut in two; garbage must not pile up.
        self._rest = text[end:][-64:]


def _socketcand_frame(kind: bytes, digits: bytes, data: bytes) -> Frame | None:
    """Three digits of an 11-bit identifier, or eight of one with 29 bits; at most eight bytes.

    None for a frame that no bus can have carried: the sample that it was to be is then missing, and
    counts so.
    """
    if len(digits) > 8 or len(data) > 16 or len(data) % 2:
        return None
    identifier = int(digits, 16)
    content = bytes.fromhex(data.decode())
    if kind == b"error":
        return identifier & IDENTIFIER | ERROR, content
    highest = {3: 0x7FF, 8: IDENTIFIER}.get(len(digits), -1)
    if identifier > highest:
        return None
    return identifier | (EXTENDED if len(digits) == 8 else 0), content
