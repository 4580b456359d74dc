"""Commands to each drive, on the wire."""

import struct

import numpy as np
import pytest

from drivers.api import Kind, PowerTarget
from tests.drivers.canopen.scripted_wire import OPERATION_ENABLED, PERIOD_S, N, everything, tick

STILL = np.zeros(N)


def test_a_setpoint_on_the_wire(scripted, drives):
    tick(drives, scripted, everything())
    scripted.sent.clear()
    drives.command(PowerTarget.ON, np.linspace(-0.3, 0.3, N))
    gears = np.array([150, 150, 100, 100, 100, 80, 80])
    counts = np.rint(np.linspace(-0.3, 0.3, N) * gears * 600 / (2 * np.pi)).astype(int)
    assert scripted.sent == [
        (0x200 + node, struct.pack("<Hi", 0x0F, counts[node - 1])) for node in range(1, N + 1)
    ]


@pytest.mark.parametrize(
    ("statusword", "power"),
    [
        (0x23, PowerTarget.ON),
        (0x07, PowerTarget.ON),
        (0x08, PowerTarget.ON),
        (OPERATION_ENABLED, PowerTarget.QUICK_STOP),
        (OPERATION_ENABLED, PowerTarget.OFF),
    ],
)
def test_a_drive_that_is_not_in_operation_gets_no_velocity(scripted, drives, statusword, power):
    tick(drives, scripted, everything(statusword))
    scripted.sent.clear()
    drives.command(power, np.full(N, 0.5))
    assert len(scripted.sent) == N
    assert {data[2:] for _, data in scripted.sent} == {bytes(4)}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_velocity_that_is_not_finite_stops_the_arm(scripted, drives, bad):
    tick(drives, scripted, everything())
    scripted.sent.clear()
    velocity = np.full(N, 0.5)
    velocity[2] = bad
    drives.command(PowerTarget.ON, velocity)
    assert {data for _, data in scripted.sent} == {struct.pack("<Hi", 0x02, 0)}
    assert [event.kind for event in tick(drives, scripted, []).events] == [Kind.BAD_SETPOINT]


def test_a_reset_is_an_edge(scripted, drives):
    words = []
    for k in range(4):
        tick(drives, scripted, everything(0x08), k * PERIOD_S)
        scripted.sent.clear()
        drives.command(PowerTarget.OFF, STILL, reset=True)
        words.append({data[:2] for _, data in scripted.sent})
    assert words == [{b"\x80\0"}, {b"\0\0"}] * 2


def test_the_quick_stop_needs_neither_samples_nor_state(scripted, drives):
    drives.quick_stop()
    stops = [(0x200 + node, bytes([0x02, 0, 0, 0, 0, 0])) for node in range(1, N + 1)]
    by_sdo = [(0x600 + node, bytes.fromhex("2b40600002000000")) for node in range(1, N + 1)]
    assert scripted.sent == [*stops, *by_sdo, (0x080, b"")]
