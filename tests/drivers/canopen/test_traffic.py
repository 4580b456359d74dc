"""Load of the bus, and who makes it."""

import pytest

from drivers.can.load import bus_load
from drivers.can.traffic import WINDOW_S, Traffic
from drivers.can.wire import EXTENDED
from drivers.canopen.make import frames

PERIOD_S = 0.01
BITRATE = 1_000_000


@pytest.fixture
def traffic(joint_drives) -> Traffic:
    return Traffic(frames(joint_drives, PERIOD_S), PERIOD_S, BITRATE)


def flooded(traffic: Traffic, ids: list[int], ticks: int = 12, late: int = 0) -> None:
    """Every tick brings these unknown frames of eight bytes, and so many late TPDOs."""
    for k in range(1, ticks + 1):
        for can_id in ids:
            traffic.take(can_id, 8, unknown=True)
        traffic.step(k * PERIOD_S, late * k)


def test_the_arm_alone_is_no_load_to_speak_of(traffic: Traffic) -> None:
    for k in range(1, 100):
        for node in range(1, 8):
            traffic.take(0x700 + node, 1, unknown=False)
        traffic.step(k * PERIOD_S, 0)
        assert traffic.loaded is None


def test_who_loads_it_is_named_with_figures(traffic: Traffic) -> None:
    flooded(traffic, [0x123] * 60 + [0x55] * 10)
    loaded = traffic.loaded
    assert loaded is not None
    assert loaded.most == 0x123
    assert loaded.unknown_hz == pytest.approx(7000.0)
    assert loaded.load == 1.0
    assert loaded.text == "bus load at least 100 %, 7000 unknown frames/s, 0x123 among them"


def test_the_load_is_that_of_all_frames(traffic: Traffic, joint_drives) -> None:
    """Without stuff bits, so that it is less than what is computed at worst."""
    flooded(traffic, [0x123] * 52)
    assert traffic.loaded is not None
    worst = bus_load(frames(joint_drives, PERIOD_S), BITRATE) + 52 * 135 * 100 / BITRATE
    nominal = 52 * 111 * 100 / BITRATE
    assert nominal + 0.1 < traffic.loaded.load < worst


@pytest.mark.parametrize(
    ("ids", "most"),
    [
        ([*range(0x300, 0x300 + 70)], None),
        ([*range(0x300, 0x330), *[0x123] * 60], 0x123),
        ([0x123 | EXTENDED] * 60, 0x123),
    ],
)
def test_an_identifier_is_named_where_it_stands_out(
    traffic: Traffic, ids: list[int], most: int | None
) -> None:
    flooded(traffic, ids)
    assert traffic.loaded is not None
    assert traffic.loaded.most == most


def test_a_babbling_drive_loads_it_too(traffic: Traffic) -> None:
    flooded(traffic, [], late=60)
    assert traffic.loaded is not None
    assert traffic.loaded.text.startswith("bus load at least ")


def test_it_is_over_with_the_window_after_it(traffic: Traffic) -> None:
    flooded(traffic, [0x123] * 70)
    for k in range(13, 13 + 2 * round(WINDOW_S / PERIOD_S) + 1):
        traffic.step(k * PERIOD_S, 0)
    assert traffic.loaded is None
