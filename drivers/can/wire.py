"""Frames, and the wire that takes them in and out of an open bus at the cost of the tick.

A frame is (can_id, data), can_id with Linux' flags above the identifier, so that one look-up finds
the TPDOs among all frames. python-can builds an object and asks the kernel several times for every
frame; where the bus is a socket, a serial line or a queue, its wire reads and writes that itself. A
wire never blocks on sending, and raises one of `drivers.can.bus.BUS_FAILURES` when the bus fails.
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
IDENTIFIER: Final = 0x1FFF_FFFF  # the bits below them: 29, of which 11 are usual

Frame = tuple[int, bytes | bytearray]


class Wire(Protocol):
    """Wire to a bus, as a tick needs it."""

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, waiting at most `timeout` s (0: not at all); None if none came."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order; the first failure ends it."""


@dataclass(frozen=True, slots=True)
class OpenBus:
    """Open bus: python-can's own object, which has opened it and shuts it down, and the wire,
    by which alone frames come and go, those of SDO and those of the tick.

    A wire keeps the bytes that it has read and not handed out, half a frame too, so there must be
    no other reader: python-can's `recv` would take such pieces and keep them for itself. Nor may
    two threads receive by a wire at once; one may send meanwhile.
    """

    python_can: can.BusABC
    wire: Wire


def frame_of(message: can.Message) -> Frame:
    """A frame that python-can received, with Linux' flags in the identifier."""
    can_id = message.arbitration_id
    if message.is_error_frame:
        can_id |= ERROR
    if message.is_extended_id:
        can_id |= EXTENDED
    if message.is_remote_frame:
        can_id |= REMOTE
    return can_id, message.data


def digits_of(can_id: int) -> bytes:
    """Identifier as text adapters write it: three digits, or eight of one with 29 bits."""
    return b"%03X" % can_id if can_id < EXTENDED else b"%08X" % (can_id & IDENTIFIER)


def first_of(
    frames: deque[Frame], port: socket.socket | int, read: Callable[[], None], timeout: float
) -> Frame | None:
    """First of `frames`, which `read` fills from `port`. A read may return a piece of a frame, or
    an adapter's acknowledgement: the whole timeout is waited for a frame."""
    left, deadline = timeout, time.monotonic() + timeout
    while not frames:
        # Not only to wait: an idle line reads like one that has ended.
        if not select.select([port], [], [], max(left, 0.0))[0]:
            return None
        read()
        left = deadline - time.monotonic()
        if left <= 0.0:
            break
    return frames.popleft() if frames else None
