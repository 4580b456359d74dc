"""Frames to the bus: setpoints, the master's heartbeat, NMT commands and stops.

Bus failures are reported as events, not raised.
"""

from collections.abc import Iterable, Sequence

from drivers.can.bus import BUS_FAILURES
from drivers.can.failures import bus_failure
from drivers.can.wire import Frame, Wire
from drivers.canopen.events import Report
from drivers.canopen.expedited_stop import expedited_quick_stops
from drivers.canopen.ids import ENTER_PRE_OPERATIONAL, HEARTBEAT, NMT, OPERATIONAL, START_NODE, SYNC
from drivers.canopen.setpoints import Setpoints
from drivers.canopen.settings import CanopenDrive

SYNC_FRAME: Frame = (SYNC, b"")


class Outbox:
    """Writer of one wire, with the outgoing frames of an arm."""

    def __init__(
        self, wire: Wire, drives: Sequence[CanopenDrive], master_node: int, report: Report
    ) -> None:
        """Raises ConfigurationError if a PDO layout does not fit."""
        self.setpoints = Setpoints(drives)
        self.heartbeat: Frame = (HEARTBEAT + master_node, bytes([OPERATIONAL]))
        self._wire, self._report = wire, report
        self._nodes = tuple(drive.node for drive in drives)
        self._stops_by_sdo = expedited_quick_stops(drives)

    @property
    def master_ids(self) -> set[int]:
        """Identifiers that only the master sends."""
        setpoints = (cob_id for cob_id, _ in self.setpoints.frames)
        return {NMT, SYNC, self.heartbeat[0], *setpoints}

    def send(self, frames: Sequence[Frame]) -> bool:
        """Send frames; False, with an event, if the bus does not accept all of them."""
        try:
            self._wire.send(frames)
        except BUS_FAILURES as error:
            self._report(bus_failure("sending", error))
            return False
        return True

    def start(self, joints: Iterable[int]) -> None:
        """Command NMT operational for the drives of these joints."""
        nodes = (self._nodes[i] for i in joints)
        self.send([self.heartbeat, *(_nmt(START_NODE, node) for node in nodes)])

    def quick_stop(self) -> None:
        """Quick-stop all drives: those that are set up by RPDO and SYNC, all by SDO."""
        self.send([*self.setpoints.quick_stops, *self._stops_by_sdo, SYNC_FRAME])

    def end(self) -> None:
        """Command pre-operational, so that a late setpoint has no effect, then a last heartbeat.

        The drives detect the subsequent silence and stop by themselves (0x6007), which changes
        nothing for one that is off or holds in quick stop.
        """
        ends = (_nmt(ENTER_PRE_OPERATIONAL, node) for node in self._nodes)
        self.send([*ends, self.heartbeat])


def _nmt(command: int, node: int) -> Frame:
    return NMT, bytes([command, node])
