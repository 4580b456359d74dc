"""Watches on one drive: heartbeat, and whether it stops when it is told to."""

import pytest
from drivers.watches import (
    HEARTBEATS_MISSED,
    PATIENCE_S,
    PATIENCE_TICKS,
    HeartbeatWatch,
    ObedienceWatch,
)

from drivers.cia402 import DriveState, PowerTarget
from drivers.events import Disobedient, HeartbeatLost, NotOperational, Rebooted, Unstoppable

PRE_OPERATIONAL, OPERATIONAL, STOPPED, BOOT_UP = 127, 5, 4, 0


@pytest.fixture
def watch():
    return HeartbeatWatch(3, timeout_s=0.25, heard_at=10.0)


def test_three_may_go_missing():
    assert HEARTBEATS_MISSED == 3


def test_silence_is_told_once(watch):
    assert watch.check(10.25) is None
    assert watch.check(10.251) == HeartbeatLost(3)
    assert watch.check(10.3) is None


def test_silence_while_nobody_listened_is_excused(watch):
    watch.excuse(20.0)
    assert watch.check(20.25) is None
    assert watch.check(20.251) == HeartbeatLost(3)
    watch.excuse(30.0)
    assert watch.lost, "what was lost before must be heard first"


def test_a_heartbeat_that_comes_back_can_be_lost_again(watch):
    watch.check(11.0)
    assert watch.hear(OPERATIONAL, 12.0) is None
    assert watch.check(12.25) is None
    assert watch.check(12.3) == HeartbeatLost(3)


@pytest.mark.parametrize(
    ("heard", "told", "forgot"),
    [
        ([], [], False),
        ([OPERATIONAL, OPERATIONAL], [], False),
        ([OPERATIONAL, PRE_OPERATIONAL, PRE_OPERATIONAL], [NotOperational(3, 127)], True),
        ([OPERATIONAL, STOPPED], [NotOperational(3, 4)], True),
        # The first ones may have been sent before NMT start came.
        ([PRE_OPERATIONAL, PRE_OPERATIONAL, OPERATIONAL], [], False),
        ([PRE_OPERATIONAL, OPERATIONAL, PRE_OPERATIONAL], [NotOperational(3, 127)], True),
        ([BOOT_UP], [Rebooted(3)], True),
        ([OPERATIONAL, BOOT_UP, PRE_OPERATIONAL], [Rebooted(3)], True),
        ([OPERATIONAL, STOPPED, OPERATIONAL, STOPPED], [NotOperational(3, 4)] * 2, True),
        # Operational again by somebody else: it does not hold what it was told, all the same.
        ([OPERATIONAL, STOPPED, OPERATIONAL], [NotOperational(3, 4)], True),
        # Node guarding toggles bit 7.
        ([OPERATIONAL | 0x80, OPERATIONAL], [], False),
    ],
)
def test_states(watch, heard, told, forgot):
    events = [watch.hear(state, 10.0 + 0.05 * k) for k, state in enumerate(heard)]
    assert [event for event in events if event] == told
    assert watch.forgot is forgot
    assert watch.operational is (heard[-1:] in ([OPERATIONAL], [OPERATIONAL | 0x80]))
    assert watch.lost is False


ON = DriveState.OPERATION_ENABLED
STOP, OFF = PowerTarget.QUICK_STOP, PowerTarget.OFF


def told(watch: ObedienceWatch, target: PowerTarget, period_s: float, ticks: int) -> list[object]:
    """(tick, event) of a drive that stays in operation; it is told in tick 0."""
    found = [(k, watch.check(ON, target, k * period_s)) for k in range(ticks)]
    return [(k, event) for k, event in found if event]


@pytest.mark.parametrize(
    ("target", "period_s", "after"),
    [
        (STOP, 0.00101, 50),
        (STOP, 0.0101, PATIENCE_TICKS),
        (STOP, 0.05, PATIENCE_TICKS),
        (STOP, 10.0, PATIENCE_TICKS),
        (OFF, 0.0101, 100),
    ],
)
def test_first_an_nmt_stop_then_silence(target: PowerTarget, period_s: float, after: int) -> None:
    found = told(ObedienceWatch(3), target, period_s, 3 * after + 3)
    again = 2 * after + 1
    assert found == [
        (after, Disobedient(3)),
        (again, Unstoppable(3)),
        (again + after + 1, Unstoppable(3)),
    ]


@pytest.mark.parametrize("state", set(DriveState) - {ON})
def test_a_drive_that_has_left_operation_obeys(state: DriveState) -> None:
    watch = ObedienceWatch(3)
    assert told(watch, STOP, 0.02, PATIENCE_TICKS) == []
    assert watch.check(state, STOP, 1.0) is None
    # What it does later is counted anew, from the NMT stop on.
    assert told(watch, STOP, 0.02, PATIENCE_TICKS + 1) == [(PATIENCE_TICKS, Disobedient(3))]
    assert watch.check(state, STOP, 1.0) is None
    assert told(watch, STOP, 0.02, PATIENCE_TICKS + 1) == [(PATIENCE_TICKS, Disobedient(3))]


def test_a_drive_that_is_to_run_obeys_by_running() -> None:
    watch = ObedienceWatch(3)
    assert told(watch, PowerTarget.ON, 0.02, 100) == []
    told(watch, STOP, 0.02, PATIENCE_TICKS)
    assert watch.check(ON, PowerTarget.ON, 1.0) is None
    assert told(watch, STOP, 0.02, PATIENCE_TICKS) == []


def test_the_bounds_are_those_of_the_documentation() -> None:
    assert ({STOP: 0.05, OFF: 1.0}, 5) == (PATIENCE_S, PATIENCE_TICKS)
