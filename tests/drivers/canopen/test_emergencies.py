"""Emergencies that are not over are objections to arming."""

import pytest

from drivers.api import Objection
from drivers.canopen.cia402 import drive_status
from drivers.canopen.emergencies import Emergencies
from drivers.canopen.events import Emergency
from tests.drivers.canopen.scripted_wire import restarted

ON, OFF, FAULT = (drive_status(word) for word in (0x27, 0x40, 0x08))
HOT, OVER = Emergency(3, 0x4210, 8), Emergency(3, 0, 0)


@pytest.fixture
def emergencies() -> Emergencies:
    return Emergencies({1: "shoulder", 3: "elbow"})


def after(emergencies, *events, elbow=ON):
    emergencies.watch(events, (ON, elbow))
    return [objection.check for objection in emergencies.objections()]


def test_it_lasts_until_the_drive_takes_it_back(emergencies):
    assert after(emergencies, HOT) == ["emergencies"]
    words = "0x4210 (over-temperature of the drive), error register 0x08"
    text = f"emergency of node 3 (elbow): {words}, still active"
    assert list(emergencies.objections()) == [Objection("emergencies", text)]
    assert after(emergencies) == ["emergencies"]
    assert after(emergencies, OVER) == []


def test_it_is_over_when_the_drive_restarts_or_is_set_up_again(emergencies):
    after(emergencies, HOT)
    assert after(emergencies, restarted(3)) == []
    assert after(emergencies, restarted(3), HOT) == ["emergencies"]
    emergencies.renewed([0])  # another joint's
    assert after(emergencies) == ["emergencies"]
    emergencies.renewed([1])
    assert after(emergencies) == []
    after(emergencies, HOT)
    emergencies.renewed(None)
    assert after(emergencies) == []


def test_one_after_another_that_was_taken_back_counts(emergencies):
    after(emergencies, Emergency(3, 0x2310, 1), elbow=FAULT)
    assert after(emergencies, OVER) == []
    assert after(emergencies, HOT) == ["emergencies"], "of a drive that goes on"


def test_a_reset_forgets_those_of_drives_that_are_not_in_fault(emergencies):
    after(emergencies, HOT)
    emergencies.acknowledge()
    assert after(emergencies, HOT, elbow=FAULT) == ["emergencies"]
    emergencies.acknowledge()
    assert after(emergencies, elbow=FAULT) == ["emergencies"]
    assert after(emergencies, elbow=OFF) == [], "it leaves its fault, and need not report it"


def test_a_drive_that_misses_our_heartbeat_fails_heartbeats(emergencies):
    assert after(emergencies, Emergency(3, 0x8130, 16)) == ["heartbeats"]
