"""Lines in lockstep: a bus of each interface, with both of its ends in this process.

How many frames are on their way is known, and they are waited for: what one end has sent, the other
has before it goes on. So a busy machine takes longer and sees the same.
"""

import errno
import itertools
import os
import re
import socket
import tty
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from queue import Queue
from typing import Protocol
from unittest.mock import patch

import can
from can.interfaces.virtual import VirtualBus

from bench.rigs.line_ends import MARK, READ_SIZE, AwaitedWire, InterfaceEnd, PatientWire, TextEnd
from drivers.can.bus import open_bus
from drivers.can.settings import BusSettings
from drivers.can.virtual import open_end
from drivers.can.wire import OpenBus, Wire
from simulator.socketcand import HELLO, Conversation, frame_line

_SLCAN = re.compile(rb"t([0-9A-Fa-f]{3})[0-8]((?:[0-9A-Fa-f]{2})*)\r")
_SO_RCVBUFFORCE = 33  # asm-generic/socket.h; not in Python's socket module

INTERFACES = deque(os.environ.get("CONTACTD_VCAN", "").split())
"""CAN interfaces that are up and serve nothing else; `make system` makes some."""

_channels = itertools.count()


class FarEnd(Protocol):
    """The drives' end."""

    def send(self, msg: can.Message) -> None:
        """Put a frame on the line."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, waiting at most `timeout` s."""


@dataclass(frozen=True, slots=True)
class Line:
    """A bus in lockstep. `full` is what the daemon's wire raises that takes no more frames."""

    near: OpenBus  # The daemon's end, as it is: for SDO, whose answers are waited for anyway.
    wire: Wire  # The same for the tick, which waits for what is on its way.
    far: FarEnd
    full: Exception
    unplug: Callable[[], None] | None = None  # Takes the adapter away; None where there is none.
    hand_over: Callable[[], None] = lambda: None  # To be called when the tick takes over from SDO.
    channel: str = ""  # Of a virtual bus, for listeners.


OpenLine = Callable[[], AbstractContextManager[Line]]


class FrameQueue(Queue[can.Message]):
    """Queue of one end, without a limit, and quicker for it."""

    def put(self, item: can.Message, block: bool = True, timeout: float | None = None) -> None:
        with self.mutex:
            self.queue.append(item)
            if len(self.queue) == 1:  # no one waits for more than the first
                self.not_empty.notify()


class LockstepBus(VirtualBus):
    """python-can's virtual bus without its deep copy of every frame, which costs as much as the
    rest of a tick's exchange: both ends here only read what they receive."""

    def __init__(self, channel: str) -> None:
        super().__init__(channel)
        self.channel.remove(self.queue)
        self.queue = FrameQueue()
        self.channel.append(self.queue)
        self._taken: deque[can.Message] = deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put the frame itself into every other end's queue."""
        for queue in self.channel:
            if queue is not self.queue:
                queue.put(msg, timeout=timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, unfiltered."""
        if not self._taken:
            self._check_if_open()
            queue = self.queue
            with queue.mutex:
                if not queue.queue and timeout != 0.0:
                    queue.not_empty.wait_for(lambda: queue.queue, timeout)
                self._taken.extend(queue.queue)
                queue.queue.clear()
        return self._taken.popleft() if self._taken else None


@contextmanager
def virtual_line() -> Iterator[Line]:
    """Queues, which are there at once; full is what a network interface would say."""
    full = can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
    channel = f"lockstep-{next(_channels)}"
    with LockstepBus(channel) as far, LockstepBus(channel) as near:
        bus = open_end(near)
        yield Line(bus, bus.wire, far, full, channel=channel)


@contextmanager
def socketcand_line() -> Iterator[Line]:
    """TCP on the loopback interface."""
    with socket.create_server(("127.0.0.1", 0)) as listener, ThreadPoolExecutor(1) as pool:
        greeted = pool.submit(_greet, listener)
        port = listener.getsockname()[1]
        near = open_bus(BusSettings(interface="socketcand", channel="can0", port=port))
        connection, conversation = greeted.result()

    def decode(data: bytes) -> list[can.Message]:
        return [frame for frame in conversation.feed(data) if isinstance(frame, can.Message)]

    def encode(message: can.Message) -> bytes:
        if message.is_error_frame:
            return b"< error %03X 0.0 >" % message.arbitration_id
        return frame_line(message, 0.0)

    full = BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
    far = TextEnd(connection.detach(), encode, decode)
    yield from _awaited_line(near, far, full)


@contextmanager
def slcan_line() -> Iterator[Line]:
    """A pseudo-terminal in place of an adapter."""
    adapter, ours = os.openpty()
    tty.setraw(adapter)
    tty.setraw(ours)
    # python-can waits two seconds for the adapter to wake up.
    with patch("can.interfaces.slcan.time.sleep"):
        near = open_bus(BusSettings(interface="slcan", channel=os.ttyname(ours)))
    os.close(ours)
    rest = b""

    def decode(data: bytes) -> list[can.Message]:
        nonlocal rest
        *lines, rest = (rest + data).split(b"\r")
        found = (_SLCAN.fullmatch(line + b"\r") for line in lines)
        return [
            can.Message(arbitration_id=int(line[1], 16), data=bytes.fromhex(line[2].decode()),
                        is_extended_id=False)
            for line in found if line
        ]  # fmt: skip

    def encode(message: can.Message) -> bytes:
        assert not message.is_error_frame, "slcan has no error frames"
        data = message.data.hex().encode()
        return b"t%03X%d%s\r" % (message.arbitration_id, len(message.data), data)

    full = can.CanOperationError("the adapter does not keep up")
    yield from _awaited_line(near, TextEnd(adapter, encode, decode), full)


@contextmanager
def socketcan_line() -> Iterator[Line]:
    """One of `INTERFACES`, which no other test uses meanwhile."""
    channel = INTERFACES.popleft()
    full = OSError(errno.ENOBUFS, os.strerror(errno.ENOBUFS))
    try:
        with can.Bus(interface="socketcan", channel=channel) as bus:
            near = open_bus(BusSettings(interface="socketcan", channel=channel))
            for end in (bus, near.python_can):
                # The usual buffer holds fewer frames than a pass reads, and drops what is more.
                end.socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, 4 << 20)  # type: ignore[attr-defined]
            yield from _awaited_line(near, InterfaceEnd(bus), full)
    finally:
        INTERFACES.append(channel)


LINES: dict[str, OpenLine] = {
    "virtual": virtual_line,
    "socketcand": socketcand_line,
    "slcan": slcan_line,
}
if INTERFACES:
    LINES["socketcan"] = socketcan_line


# --- lines whose frames take their time -----------------------------------------------------------


def _awaited_line(opened: OpenBus, far: TextEnd | InterfaceEnd, full: Exception) -> Iterator[Line]:
    patient = PatientWire(opened.wire)
    near = replace(opened, wire=patient)
    unplug = far.unplug if isinstance(far, TextEnd) else None

    def hand_over() -> None:
        """Discard what SDO has left on the line: both ends read up to a mark. The drives
        have done with what came before it; the daemon has not."""
        near.wire.send([(MARK, b"")])
        found = None
        while found is None or found.arbitration_id != MARK:
            far.to_drives = 1
            found = far.recv()
        far.send(can.Message(arbitration_id=MARK, is_extended_id=False))
        left = patient.take_in()
        far.to_daemon, far.to_drives = left, 0

    try:
        yield Line(near, AwaitedWire(patient, far), far, full, unplug, hand_over)
    finally:
        with suppress(OSError, can.CanError):
            near.python_can.shutdown()
        if unplug:
            unplug()


def _greet(listener: socket.socket) -> tuple[socket.socket, Conversation]:
    """The server's part until the daemon takes frames; it tries with a connection of its own."""
    while True:
        connection, _ = listener.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.sendall(HELLO)
        conversation = Conversation()
        while data := connection.recv(READ_SIZE):
            for answer in conversation.feed(data):
                assert not isinstance(answer, can.Message)
                connection.sendall(answer.data)
            if conversation.raw_mode:
                return connection, conversation
        connection.close()
