"""Events of the bus as the daemon gets them: their kind, and text that names the joints."""

from typing import get_args

import pytest

from drivers.api import Event, Kind
from drivers.canopen.crossing import KIND_OF, crossing
from drivers.canopen.events import (
    Absent,
    AdapterGone,
    BadSetpoint,
    BusEvent,
    BusOff,
    Emergency,
    ErrorPassive,
    ForeignMaster,
    HeartbeatLost,
    LateAnswer,
    NotOperational,
    NotSeenToStop,
    Rebooted,
    Unproved,
)

JOINTS = {1: "shoulder", 3: "elbow"}


@pytest.mark.parametrize(
    ("event", "kind", "text"),
    [
        (HeartbeatLost(3), Kind.SILENT, "node 3 (elbow)"),
        (HeartbeatLost(7), Kind.SILENT, "node 7"),
        (
            Emergency(1, 0x8130, 0x11),
            Kind.UNHEARD,
            "node 1 (shoulder): 0x8130 (heartbeat of the master lost), error register 0x11",
        ),
        (Emergency(3, 0xA123, 5), Kind.ERROR, "node 3 (elbow): 0xA123, error register 0x05"),
        (Rebooted(3), Kind.RESTARTED, "node 3 (elbow): its set-up is lost"),
        (NotSeenToStop((3,)), Kind.NOT_SEEN_TO_STOP, "node 3 (elbow): NMT stop sent"),
        (
            Unproved((1, 3)),
            Kind.UNPROVED,
            "node 1 (shoulder), node 3 (elbow): no heartbeat of ours any more",
        ),
        (Absent(0.312), Kind.ABSENT, "the drives heard nothing of it for 312 ms"),
        (
            NotOperational(3, 127),
            Kind.DROPPED,
            "node 3 (elbow): no longer operational (NMT state 127)",
        ),
        (ForeignMaster(0x080), Kind.FOREIGN_MASTER, "it sends 0x080"),
        (BadSetpoint("elbow: nan"), Kind.BAD_SETPOINT, "elbow: nan"),
        (ErrorPassive(), Kind.PASSIVE, "cable, termination, bitrate?"),
        (BusOff(), Kind.OFF_BUS, ""),
        (AdapterGone("no such device"), Kind.ADAPTER_GONE, "no such device"),
        (LateAnswer(3), Kind.DISTURBED, "node 3 (elbow): answers later than a whole period"),
    ],
)
def test_kind_and_text(event: BusEvent, kind: Kind, text: str) -> None:
    assert crossing(event, JOINTS) == Event(kind, text)


def test_an_emergency_that_is_over_is_none() -> None:
    assert crossing(Emergency(3, 0, 0), JOINTS) is None


def test_every_event_has_a_kind_and_every_kind_an_event() -> None:
    assert set(KIND_OF) == set(get_args(BusEvent))
    assert {*KIND_OF.values(), Kind.UNHEARD} == set(Kind)
