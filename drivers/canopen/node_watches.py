"""Watches on all nodes of an arm: heartbeats, NMT states, emergencies, state of the set-up.

Frames are turned into events, whose meaning is decided elsewhere. Time is an argument.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.canopen.cia402 import DriveState
from drivers.canopen.emergency_codes import OF_COMMUNICATION, PROTOCOL_ERROR, UNKNOWN_CODE
from drivers.canopen.events import BusEvent, Emergency
from drivers.canopen.heartbeat_watch import HeartbeatWatch
from drivers.canopen.ids import EMERGENCY, HEARTBEAT, NODE
from drivers.canopen.settings import HEARTBEATS_MISSED, CanopenDrive

#: Drives delay their emergencies (inhibit time 0x1015): a protocol error (0x82xx) within this time
#: of the set-up, which was read back, concerns earlier frames.
SETTLING_S: Final = 0.5


@dataclass(slots=True)
class _Node:
    beat: HeartbeatWatch
    set_up_s: float
    complained: bool = False  # communication error (0x81xx, 0x82xx) since its set-up


class NodeWatches:
    """One watch for each drive, in the order of the joints."""

    def __init__(self, drives: Sequence[CanopenDrive]) -> None:
        self._drives, self.unknown_frames = tuple(drives), 0
        self.joint_of = {drive.node: joint for joint, drive in enumerate(drives)}
        self._nodes = [self._watched(drive, 0.0) for drive in drives]

    def _watched(self, drive: CanopenDrive, now: float) -> _Node:
        timeout_s = HEARTBEATS_MISSED * (drive.profile.heartbeat_ms / 1e3)
        return _Node(HeartbeatWatch(drive.node, timeout_s, now), now)

    def start(self, now: float, renewed: Iterable[int] | None) -> None:
        """Expect heartbeats from `now` on. `renewed` were just set up (None: all); the history of
        the others is kept."""
        for node in self._nodes:
            node.beat.restart(now)
        for i in range(len(self._nodes)) if renewed is None else renewed:
            self._nodes[i] = self._watched(self._drives[i], now)

    def on_frame(self, can_id: int, data: bytes | bytearray, now: float) -> BusEvent | None:
        """Take a heartbeat or an emergency; any other frame is counted as unknown."""
        joint, service = self.joint_of.get(can_id & NODE), can_id & ~NODE
        if joint is None or service not in (HEARTBEAT, EMERGENCY):
            self.unknown_frames += 1
            return None
        node = self._nodes[joint]
        if service == HEARTBEAT:
            return node.beat.on_heartbeat(data[0], now) if data else None
        code = data[0] | data[1] << 8 if len(data) > 1 else UNKNOWN_CODE
        kind = code & 0xFF00
        node.complained |= kind in OF_COMMUNICATION
        if kind == PROTOCOL_ERROR and now - node.set_up_s < SETTLING_S:
            return None
        return Emergency(node.beat.node, code, data[2] if len(data) > 2 else 0)

    def check(self, now: float) -> Iterator[BusEvent]:
        """Events for heartbeats that have just become overdue."""
        for node in self._nodes:
            if event := node.beat.check(now):
                yield event

    def distrust(self, joints: Iterable[int]) -> None:
        """Count the drives of these joints as not set up, until they are set up again."""
        for i in joints:
            self._nodes[i].beat.forgot = True

    @property
    def set_up(self) -> list[bool]:
        """True for each drive that, as far as is known, still has its set-up."""
        return [not node.beat.forgot for node in self._nodes]

    @property
    def fit(self) -> list[int]:
        """Joints whose drives still have their set-up."""
        return [i for i, set_up in enumerate(self.set_up) if set_up]

    @property
    def unset(self) -> list[int]:
        """Joints whose drives have lost their set-up."""
        return [i for i, set_up in enumerate(self.set_up) if not set_up]

    @property
    def unheard(self) -> list[int]:
        """Joints whose drives send no heartbeat, or one that does not report operational."""
        beats = (node.beat for node in self._nodes)
        return [i for i, beat in enumerate(beats) if beat.lost or not beat.operational]

    def unfit(self, states: Sequence[DriveState]) -> list[int]:
        """Joints whose drives are silent, restarted, no longer operational, or in fault after a
        communication error (0x81xx, 0x82xx, CiA 301): a later error may mask that one, and only a
        communication reset ends it."""
        return [
            i
            for i, (node, state) in enumerate(zip(self._nodes, states, strict=True))
            if node.beat.forgot or node.beat.lost or (state is DriveState.FAULT and node.complained)
        ]
