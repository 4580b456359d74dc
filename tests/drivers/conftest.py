"""A virtual bus of its own for each test."""

from collections.abc import Iterator
from itertools import count

import can
import pytest

_channels = count()


@pytest.fixture
def wire() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Both ends of a virtual bus that no other test uses."""
    channel = f"drivers-{next(_channels)}"
    ends = tuple(can.Bus(interface="virtual", channel=channel) for _ in range(2))
    yield ends[0], ends[1]
    for end in ends:
        end.shutdown()
