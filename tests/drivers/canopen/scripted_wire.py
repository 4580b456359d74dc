"""Scripted wire without drives, and the frames that seven would send: for tests of a tick."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import can
import yaml

from drivers.api import Event, Kind, Samples
from drivers.can.wire import Frame, frame_of
from drivers.canopen.drives import CanopenDrives
from drivers.canopen.events import BusEvent, Fact, crossing

ROBOT = Path(__file__).parents[3] / "configs" / "romeo_left_arm"
CONFIG: dict[str, Any] = yaml.safe_load((ROBOT / "config.yaml").read_text())
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


class ScriptedWire:
    """Wire that delivers the frames it is given, and keeps those that are sent."""

    def __init__(self) -> None:
        self.incoming: list[can.Message] = []
        self.sent: list[tuple[int, bytes]] = []
        self.waits: list[float] = []
        self.failure: Exception | None = None

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, as `Wire.receive`."""
        if self.failure:
            raise self.failure
        self.waits.append(timeout)
        return frame_of(self.incoming.pop(0)) if self.incoming else None

    def send(self, frames: Sequence[Frame]) -> None:
        """Keep the frames, as `Wire.send`."""
        if self.failure:
            raise self.failure
        self.sent += [(can_id, bytes(data)) for can_id, data in frames]


def restarted(node: int) -> Fact:
    """A drive has restarted."""
    return Fact(Kind.RESTARTED, (node,), "its set-up is lost")


def dropped(node: int, nmt_state: int = 127) -> Fact:
    """A drive has left operational."""
    return Fact(Kind.DROPPED, (node,), f"no longer operational (NMT state {nmt_state})")


def crossed(*events: BusEvent) -> tuple[Event, ...]:
    """These, as the daemon gets them."""
    joints = {number: joint["name"] for number, joint in enumerate(CONFIG["joints"], start=1)}
    return tuple(event for each in events if (event := crossing(each, joints)))


def tick(
    drives: CanopenDrives, wire: ScriptedWire, frames: list[can.Message], now: float = PERIOD_S
) -> Samples:
    """SYNC, and these frames as the answer; the command is the caller's."""
    drives.sync(now)
    wire.incoming += frames
    return drives.collect(now)
