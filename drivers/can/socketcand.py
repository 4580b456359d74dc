"""socketcand: a CAN bus over TCP, with each frame as text."""

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
    """Open a bus of a socketcand server. Raises BusError if the server or its bus is missing."""
    _refuse_missing_server(settings)
    bus = can.Bus(
        interface="socketcand",
        host=settings.host,
        port=settings.port,
        channel=settings.channel,
        tcp_tune=True,
    )
    # python-can has no public attribute for its connection.
    stream = getattr(bus, "_SocketCanDaemonBus__socket", None)
    if not isinstance(stream, socket.socket):
        bus.shutdown()
        raise BusError(f"bus socketcand: python-can {can.__version__} does not expose its socket")
    return OpenBus(bus, StreamWire(stream))


def _refuse_missing_server(settings: BusSettings) -> None:
    where = f"{settings.host}:{settings.port}"
    # python-can would retry a refused connection for ten seconds, wait for a greeting indefinitely,
    # and leave its socket open after a refusal; so probe with a connection of our own first.
    try:
        with socket.create_connection((settings.host, settings.port), _CONNECT_TIMEOUT_S) as probe:
            greeting = probe.recv(64)
            if greeting != b"< hi >":
                raise BusError(f"bus socketcand: {where} answers, but is no socketcand server")
            probe.sendall(f"< open {settings.channel} >".encode())
            answer = probe.recv(256)
            if answer != b"< ok >":
                words = answer.decode(errors="replace")
                raise BusError(
                    f"bus socketcand: {where} does not open {settings.channel!r}: {words!r}"
                )
    except ConnectionRefusedError as error:
        raise BusError(
            f"bus socketcand: nothing listens on {where}; is `contactd simulate` running?"
        ) from error
    except OSError as error:
        raise BusError(f"bus socketcand: {where}: {error}") from error


class StreamWire:
    """socketcand's raw mode over TCP: text, with any number of frames per read."""

    # Other versions append fields to the data; more data than this is invalid.
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
            # The next frame would be read as the rest of the truncated one.
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
        # A read may end within a frame; garbage must not accumulate.
        self._rest = text[end:][-64:]


def _socketcand_frame(kind: bytes, digits: bytes, data: bytes) -> Frame | None:
    """Frame with a three-digit 11-bit identifier or an eight-digit 29-bit one, and at most eight
    bytes. None for an impossible frame: its sample is then missing."""
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
