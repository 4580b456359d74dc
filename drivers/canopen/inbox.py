"""Frames from the bus, dispatched to their handlers.

No received frame and no bus failure raises an exception.
"""

from collections.abc import Callable, Sequence
from typing import Final

from drivers.api import Kind
from drivers.can.bus import BUS_FAILURES
from drivers.can.failures import bus_failure, error_frame
from drivers.can.traffic import Traffic
from drivers.can.wire import ERROR, Frame, Wire
from drivers.canopen.answers import Answers
from drivers.canopen.emergency_codes import OF_COMMUNICATION
from drivers.canopen.events import Emergency, Fact, Report
from drivers.canopen.ids import HEARTBEAT, NODE, SDO_ANSWER
from drivers.canopen.make import frames
from drivers.canopen.node_watches import NodeWatches
from drivers.canopen.settings import CanopenDrive

#: Bound per pass: a flooded bus must not block the loop.
FRAMES_PER_PASS: Final = 512


class Inbox:
    """Reader of one wire, with the handlers of its frames."""

    def __init__(
        self,
        wire: Wire,
        drives: Sequence[CanopenDrive],
        period_s: float,
        bitrate: int,
        master_ids: set[int],
        report: Report,
        on_sdo: Callable[[int, bytes | bytearray], None],
        on_node: Callable[[], None],
        on_bus_off: Callable[[], None],
    ) -> None:
        """master_ids: identifiers that only this master may send. on_sdo receives the SDO answer
        of a node; on_node is called when the state of a node has changed, on_bus_off on bus-off.
        Raises ConfigurationError if a PDO layout does not fit."""
        self.answers = Answers(drives, report, period_s)
        self.nodes = NodeWatches(drives)
        self.traffic = Traffic(frames(drives, period_s), period_s, bitrate)
        self._wire, self._master_ids = wire, master_ids
        self._report = report
        self._on_sdo, self._on_node, self._on_bus_off = on_sdo, on_node, on_bus_off

    def receive(self, timeout: float) -> Frame | None:
        """Next frame, waiting at most `timeout` s. None on timeout or bus failure."""
        try:
            return self._wire.receive(timeout)
        except BUS_FAILURES as error:
            self._report(bus_failure("receiving", error))
            return None

    def read_queued(self, now: float) -> bool:
        """Take the queued frames; False if there may be more than one pass reads."""
        for _ in range(FRAMES_PER_PASS):
            frame = self.receive(0.0)
            if frame is None:
                return True
            self.take(*frame, now)
        return False

    def queued(self) -> list[Frame]:
        """Frames queued in the wire, at most those of one pass."""
        frames: list[Frame] = []
        while len(frames) < FRAMES_PER_PASS and (frame := self.receive(0.0)):
            frames.append(frame)
        return frames

    def take_after_set_up(
        self, frames: Sequence[Frame], over: Sequence[int], renewed: Sequence[int], now: float
    ) -> None:
        """Take frames received around a set-up of the drives of the `renewed` joints, except those
        that it caused: heartbeats and communication emergencies, of the services in `over`."""
        for can_id, data in frames:
            service, joint = can_id & ~NODE, self.nodes.joint_of.get(can_id & NODE)
            kind = data[1] << 8 if len(data) > 1 else 0
            of_set_up = service == HEARTBEAT or kind in OF_COMMUNICATION
            if not (joint in renewed and service in over and of_set_up):
                self.take(can_id, data, now)

    def take(self, can_id: int, data: bytes | bytearray, now: float) -> None:
        """Dispatch one frame."""
        if self.answers.take(can_id, data):
            return
        if can_id & ERROR:
            event = error_frame(can_id & ~ERROR, data)
            if event.kind is Kind.OFF_BUS:
                self._on_bus_off()
            self._report(event)
            return
        unknown = self.nodes.unknown_frames
        if can_id & ~NODE == SDO_ANSWER:  # False with any flag set: 11-bit identifiers only
            self._on_sdo(can_id & NODE, data)
        elif can_id in self._master_ids:
            self._report(Fact(Kind.FOREIGN_MASTER, text=f"it sends 0x{can_id:03X}"))
        elif found := self.nodes.on_frame(can_id, data, now):
            if not isinstance(found, Emergency):
                self._on_node()
            self._report(found)
        self.traffic.take(can_id, len(data), unknown=self.nodes.unknown_frames > unknown)
