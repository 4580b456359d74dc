"""Frames, and the wire that receives and sends them on an open bus, fast enough for the tick.

A frame is (can_id, data), where can_id has Linux flags above the identifier, so that one look-up
identifies a TPDO. python-can builds an object and makes several system calls per frame; a wire uses
the socket, serial line or queue of the bus directly. A wire never blocks on sending, and raises one
of `drivers.can.bus.BUS_FAILURES` when the bus fails.
"""

import select
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import can

EXTENDED: Final = 0x8000_0000
REMOTE: Final = 0x4000_0000
ERROR: Final = 0x2000_0000
IDENTIFIER: Final = 0x1FFF_FFFF  # identifier bits below these flags: 29, of which 11 are usual

Frame = tuple[int, bytes | bytearray]


class Wire(Protocol):
    """Interface to receive and send frames within a tick."""

    def receive(self, timeout: float) -> Frame | None:
        """Next frame, waiting at most `timeout` s (0: not at all). None on timeout."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order, up to the first failure."""


@dataclass(frozen=True, slots=True)
class OpenBus:
    """Open bus: the python-can object, which opens it and shuts it down, and the wire, which alone
    carries its frames, both SDO and cyclic ones.

    A wire buffers bytes that it has read but not yet returned, even partial frames, so it must be
    the only reader: python-can's `recv` would consume such bytes. Two threads must not receive from
    a wire at the same time; another may send meanwhile.
    """

    python_can: can.BusABC
    wire: Wire


def frame_of(message: can.Message) -> Frame:
    """Frame of a python-can message, with Linux flags in the identifier."""
    can_id = message.arbitration_id
    if message.is_error_frame:
        can_id |= ERROR
    if message.is_extended_id:
        can_id |= EXTENDED
    if message.is_remote_frame:
        can_id |= REMOTE
    return can_id, message.data


def digits_of(can_id: int) -> bytes:
    """Identifier in hexadecimal for text protocols: three digits, or eight for 29 bits."""
    return b"%03X" % can_id if can_id < EXTENDED else b"%08X" % (can_id & IDENTIFIER)


def first_of(
    frames: deque[Frame], port: socket.socket | int, read: Callable[[], None], timeout: float
) -> Frame | None:
    """First of `frames`, which `read` fills from `port`; None on timeout. As a read may return only
    part of a frame, or an adapter's acknowledgement, it is repeated until the timeout."""
    left, deadline = timeout, time.monotonic() + timeout
    while not frames:
        # Needed even without waiting: a read of an idle line looks like end of file.
        if not select.select([port], [], [], max(left, 0.0))[0]:
            return None
        read()
        left = deadline - time.monotonic()
        if left <= 0.0:
            break
    return frames.popleft() if frames else None
