"""Scripted bus without drives, and the frames that seven would send: for tests of a tick."""

import struct
from typing import Final

import can

from drivers.answers import Samples
from drivers.drives import Drives

N: Final = 7
PERIOD_S: Final = 0.010
OPERATION_ENABLED: Final = 0x27


def frame(cob_id: int, data: bytes = b"", **kind: bool) -> can.Message:
    """A frame as python-can would receive it."""
    return can.Message(arbitration_id=cob_id, data=data, **{"is_extended_id": False} | kind)


def tpdos(node: int, statusword: int = OPERATION_ENABLED) -> list[can.Message]:
    """One drive's answer to SYNC."""
    return [
        frame(0x180 + node, struct.pack("<Hhi", statusword, 500, 10 * node)),
        frame(0x280 + node, struct.pack("<ii", 1000 * node, 0)),
    ]


def everything(statusword: int = OPERATION_ENABLED) -> list[can.Message]:
    """The answers of all drives."""
    return [message for node in range(1, N + 1) for message in tpdos(node, statusword)]


class ScriptedBus:
    """Bus that delivers the frames it is given, and keeps those that are sent."""

    channel_info = "scripted"

    def __init__(self) -> None:
        self.incoming: list[can.Message] = []
        self.sent: list[tuple[int, bytes]] = []
        self.waits: list[float] = []
        self.failure: Exception | None = None

    def recv(self, timeout: float) -> can.Message | None:
        """The next frame, as `can.BusABC.recv`."""
        if self.failure:
            raise self.failure
        self.waits.append(timeout)
        return self.incoming.pop(0) if self.incoming else None

    def send(self, message: can.Message) -> None:
        """Keep a frame, as `can.BusABC.send`."""
        if self.failure:
            raise self.failure
        self.sent.append((message.arbitration_id, bytes(message.data)))


def tick(
    drives: Drives, bus: ScriptedBus, frames: list[can.Message], now: float = PERIOD_S
) -> Samples:
    """SYNC, and these frames as the answer; the command is the caller's."""
    drives.sync(now)
    bus.incoming += frames
    return drives.collect(now)
