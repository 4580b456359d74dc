"""socketcan: the kernel's CAN interfaces, with each frame as a packet."""

import select
import socket
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import can

from common.errors import BusError
from drivers.can.settings import BusSettings
from drivers.can.wire import Frame, OpenBus

_IFF_UP: Final = 0x1


def open_socketcan(settings: BusSettings) -> OpenBus:
    """Open a network interface. Raises BusError if it is missing or down."""
    _refuse_missing_interface(settings)
    bus = can.Bus(interface="socketcan", channel=settings.channel)
    return OpenBus(bus, RawWire(bus.socket))  # type: ignore[attr-defined]  # of SocketcanBus


def _refuse_missing_interface(settings: BusSettings) -> None:
    if not hasattr(socket, "AF_CAN"):
        raise BusError("bus socketcan: this Python was built without CAN sockets")
    flags = Path("/sys/class/net", settings.channel, "flags")
    if not flags.exists():
        raise BusError(
            f"bus socketcan: no interface {settings.channel!r}; `ip link` lists those there are"
        )
    if not int(flags.read_text(), 16) & _IFF_UP:
        raise BusError(
            f"bus socketcan: interface {settings.channel!r} is down; `ip link set "
            f"{settings.channel} up type can bitrate {settings.bitrate}` brings it up"
        )


class RawWire:
    """Linux CAN_RAW socket: each read returns one frame (struct can_frame of linux/can.h)."""

    _LAYOUT: Final = struct.Struct("=IB3x8s")

    def __init__(self, raw: socket.socket) -> None:
        self._socket = raw

    def receive(self, timeout: float) -> Frame | None:
        # Most answers to a SYNC are already queued: reading first saves the call of select().
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
