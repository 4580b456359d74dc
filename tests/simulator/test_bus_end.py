"""A bus that goes and comes back, at the drives' end."""

import errno
from dataclasses import dataclass, field

import can
import pytest

from common.errors import BusError
from simulator import bus_end
from simulator.bus_end import BusEnd

FRAME = can.Message(arbitration_id=0x181, is_extended_id=False)


@dataclass
class FakeInterface:
    """Interface that python-can opens: may be gone, down, or full."""

    there: bool = True
    down: bool = False
    full: bool = False
    opened: int = 0
    sent: list[can.Message] = field(default_factory=list)

    def open(self, **_: str) -> "FakeInterface":
        if not self.there:
            raise OSError(errno.ENODEV, "No such device")
        self.opened += 1
        return self

    def recv(self, timeout: float) -> None:
        if self.down or not self.there:
            raise can.CanOperationError("Network is down", errno.ENETDOWN)

    def send(self, message: can.Message) -> None:
        if self.full:
            raise can.CanOperationError("No buffer space available", errno.ENOBUFS)
        self.recv(0.0)
        self.sent.append(message)

    def shutdown(self) -> None:
        self.opened -= 1


@pytest.fixture
def interface(monkeypatch: pytest.MonkeyPatch) -> FakeInterface:
    made = FakeInterface()
    monkeypatch.setattr(can, "Bus", made.open)
    monkeypatch.setattr(bus_end, "REOPEN_S", 0.0)
    return made


def test_without_a_bus_at_the_beginning_it_is_an_error(interface: FakeInterface) -> None:
    interface.there = False
    with pytest.raises(BusError, match="no CAN bus socketcan can0"):
        BusEnd("socketcan", "can0", lambda _: None)


@pytest.mark.parametrize("what", ["there", "down"])
@pytest.mark.parametrize("noticed_by", ["send", "receive"])
def test_a_bus_that_goes_is_waited_for(
    interface: FakeInterface, what: str, noticed_by: str
) -> None:
    reports: list[str] = []
    end = BusEnd("socketcan", "can0", reports.append)
    setattr(interface, what, what == "down")
    for _ in range(5):
        end.send(FRAME) if noticed_by == "send" else end.receive(0.0)
        end.receive(0.0)
    assert len(reports) == 2
    assert reports[1].startswith("bus lost: ")
    assert interface.opened == 0
    setattr(interface, what, what == "there")
    end.receive(0.0)
    end.send(FRAME)
    assert reports[2:] == ["on socketcan can0 again"]
    assert interface.sent == [FRAME]
    end.close()
    assert interface.opened == 0


def test_a_frame_for_which_there_is_no_room_is_lost_and_the_bus_is_not(
    interface: FakeInterface,
) -> None:
    reports: list[str] = []
    end = BusEnd("socketcan", "can0", reports.append)
    interface.full = True
    end.send(FRAME)
    interface.full = False
    end.send(FRAME)
    assert reports == ["on socketcan can0"]
    assert interface.sent == [FRAME]
