"""Events of the bus, as they cross the line to the daemon: their kind, and text with the joints."""

from collections.abc import Mapping
from typing import Final

from drivers.api import Event, Kind
from drivers.canopen import events as bus
from drivers.canopen.emergency_codes import MASTER_SILENT, NO_LONGER

KIND_OF: Final[dict[type[bus.BusEvent], Kind]] = {
    bus.Emergency: Kind.ERROR,
    bus.HeartbeatLost: Kind.SILENT,
    bus.NotOperational: Kind.DROPPED,
    bus.NotSeenToStop: Kind.NOT_SEEN_TO_STOP,
    bus.Repeats: Kind.REPEATED_SAMPLES,
    bus.Unproved: Kind.UNPROVED,
    bus.Absent: Kind.ABSENT,
    bus.Rebooted: Kind.RESTARTED,
    bus.ForeignMaster: Kind.FOREIGN_MASTER,
    bus.BadSetpoint: Kind.BAD_SETPOINT,
    bus.LateAnswer: Kind.DISTURBED,
    bus.OldAnswers: Kind.OLD_SAMPLES,
    bus.TwoDrives: Kind.TWO_DRIVES,
    bus.BusLoaded: Kind.LOADED,
    bus.ErrorPassive: Kind.PASSIVE,
    bus.BusOff: Kind.OFF_BUS,
    bus.AdapterGone: Kind.ADAPTER_GONE,
    bus.BusTrouble: Kind.DISTURBED,
}


def crossing(event: bus.BusEvent, joints: Mapping[int, str]) -> Event | None:
    """Event for the daemon; None for an emergency that is over. joints: names by node."""
    kind = KIND_OF[type(event)]
    if isinstance(event, bus.Emergency):
        if event.code == NO_LONGER:
            return None
        if event.code == MASTER_SILENT:
            kind = Kind.UNHEARD
    return Event(kind, described(event, joints))


def described(event: bus.BusEvent, joints: Mapping[int, str]) -> str:
    """Text of an event, with the joint of each drive; `joints`: names by node."""
    nodes = getattr(event, "nodes", None) or (getattr(event, "node", None),)
    drives = ", ".join(
        f"node {node} ({joints[node]})" if node in joints else f"node {node}"
        for node in nodes
        if node is not None
    )
    return ": ".join(filter(None, (drives, str(event))))
