"""Loss of a drive's supply, from what it reports."""

import numpy as np
import pytest

from daemon.faults.supply import GONE_TICKS, Supply
from drivers.canopen.cia402 import VOLTAGE_ENABLED, drive_status

ON, OFF, FAULT, STOPPED = 0x27, 0x40, 0x08, 0x07
WITH = VOLTAGE_ENABLED


def taken(supply: Supply, *words: int, fresh: bool = True) -> Supply:
    """Statuswords of one drive, a tick for each."""
    for word in words:
        supply.step((drive_status(word),), np.array([fresh]))
    return supply


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        ((-1, ON, ON, ON), False),  # a drive that never had the bit
        ((ON | WITH, ON), True),
        ((ON | WITH, STOPPED), True),
        ((OFF | WITH, ON | WITH, OFF), True),
        ((OFF, ON | WITH, OFF), False),  # without power it never has it: it was switched off
        ((OFF | WITH, ON | WITH, FAULT), True),
        ((OFF | WITH, ON), False),
        ((ON | WITH, ON, ON | WITH), False),
    ],
)
def test_a_drive_is_judged_by_what_it_has_shown(words: tuple[int, ...], missing: bool) -> None:
    assert taken(Supply(1), *words).missing(0) is missing


def test_a_supply_is_lost_after_ticks_of_fresh_samples() -> None:
    supply = taken(Supply(1), ON | WITH, ON)
    assert not supply.lost(0)
    taken(supply, *[ON] * 5, fresh=False)
    assert not supply.lost(0)
    taken(supply, *[ON] * (GONE_TICKS - 1))
    assert supply.lost(0)
    supply.restart()
    assert not taken(supply, *[ON] * 5).missing(0)


def test_each_drive_is_judged_by_itself() -> None:
    supply = Supply(2)
    for word in (ON | WITH, ON, ON):
        supply.step((drive_status(ON | WITH), drive_status(word)), np.array([True, True]))
    assert [supply.lost(0), supply.lost(1)] == [False, True]
