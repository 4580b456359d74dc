"""Drives that say that they do not follow their command."""

import numpy as np
import pytest

from daemon.faults.ignored_setpoints import IGNORED_TICKS, IgnoredSetpoints
from drivers.canopen.cia402 import FOLLOWS, drive_status

FOLLOWING, IGNORING, STOPS = map(drive_status, (0x0237 | FOLLOWS, 0x0237, 0x0207))
LITTLE = np.array([0.1, -0.1])


@pytest.fixture
def watch() -> IgnoredSetpoints:
    return IgnoredSetpoints(np.array([2.0, 2.0]))


def ticks(watch, n, drives, current=LITTLE):
    return [watch.joints(drives, current, np.array([True, True])) for _ in range(n)]


def test_an_ignored_setpoint_is_reported_while_it_lasts(watch) -> None:
    assert ticks(watch, 5, (FOLLOWING, FOLLOWING)) == [[]] * 5
    expected = [[]] * (IGNORED_TICKS - 1) + [[1]] * 2
    assert ticks(watch, IGNORED_TICKS + 1, (FOLLOWING, IGNORING)) == expected
    assert ticks(watch, 1, (FOLLOWING, FOLLOWING)) == [[]]
    assert ticks(watch, 1, (FOLLOWING, IGNORING)) == [[]], "counted anew"


def test_a_drive_without_the_bit_is_not_judged_by_it(watch) -> None:
    assert ticks(watch, 20, (FOLLOWING, IGNORING)) == [[]] * 20


def test_a_drive_at_its_limit_is_not_in_another_mode(watch) -> None:
    ticks(watch, 1, (FOLLOWING, FOLLOWING))
    limited = np.array([0.1, -1.0])
    assert ticks(watch, 20, (FOLLOWING, IGNORING), current=limited) == [[]] * 20


def test_a_drive_that_is_not_in_operation_has_nothing_to_follow(watch) -> None:
    ticks(watch, 1, (FOLLOWING, FOLLOWING))
    assert ticks(watch, 20, (FOLLOWING, STOPS)) == [[]] * 20
    ticks(watch, IGNORED_TICKS - 1, (FOLLOWING, IGNORING))
    ticks(watch, 1, (FOLLOWING, STOPS))
    assert ticks(watch, 1, (FOLLOWING, IGNORING)) == [[]], "counted anew"


def test_after_a_reset_other_drives_may_be_there(watch) -> None:
    ticks(watch, 1, (FOLLOWING, FOLLOWING))
    watch.restart()
    assert ticks(watch, 20, (IGNORING, IGNORING)) == [[]] * 20
