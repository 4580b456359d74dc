"""Events of the bus as the daemon gets them: their kind, and text that names the joints."""

import pytest

from drivers.api import Event, Kind
from drivers.canopen.events import BusEvent, Emergency, Fact, crossing


@pytest.mark.parametrize(
    ("event", "kind", "text"),
    [
        (Fact(Kind.SILENT, (3,)), Kind.SILENT, "node 3 (elbow)"),
        (Fact(Kind.SILENT, (7,)), Kind.SILENT, "node 7"),
        (Fact(Kind.UNPROVED, (1, 3), "x"), Kind.UNPROVED, "node 1 (shoulder), node 3 (elbow): x"),
        (Fact(Kind.OFF_BUS), Kind.OFF_BUS, ""),
        (Fact(Kind.ADAPTER_GONE, text="x"), Kind.ADAPTER_GONE, "x"),
        (
            Emergency(1, 0x8130, 0x11),
            Kind.UNHEARD,
            "node 1 (shoulder): 0x8130 (heartbeat of the master lost), error register 0x11",
        ),
        (Emergency(3, 0xA123, 5), Kind.ERROR, "node 3 (elbow): 0xA123, error register 0x05"),
    ],
)
def test_kind_and_text(event: BusEvent, kind: Kind, text: str) -> None:
    assert crossing(event, {1: "shoulder", 3: "elbow"}) == Event(kind, text)


def test_an_emergency_that_is_over_is_none() -> None:
    assert crossing(Emergency(3, 0, 0), {}) is None
