"""A virtual bus of its own for each test, and arms of motors."""

from collections.abc import Iterator
from itertools import count

import can
import numpy as np
import pytest

from daemon.modes.table import Event, Mode
from tests.drivers.motors.one_arm import Filtered, Make, filtered

_channels = count()


@pytest.fixture
def wire() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Both ends of a virtual bus that no other test uses."""
    channel = f"drivers-{next(_channels)}"
    ends = tuple(can.Bus(interface="virtual", channel=channel) for _ in range(2))
    yield ends[0], ends[1]
    for end in ends:
        end.shutdown()


@pytest.fixture
def arm(make: Make) -> Iterator[Filtered]:
    """Motors of the make that the test names, off."""
    yield from filtered(make)


@pytest.fixture
def moving(arm: Filtered) -> Filtered:
    """The same, on its trajectory."""
    arm.rig.enable()
    arm.rig.request(Event.START)
    arm.rig.run(1.5)
    assert arm.rig.mode is Mode.TRACKING
    assert np.abs(arm.rig.samples.motor_velocity).max() > 0.1
    return arm
