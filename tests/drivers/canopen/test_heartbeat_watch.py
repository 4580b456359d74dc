"""Watch on the heartbeat of one drive."""

import pytest

from drivers.api import Kind
from drivers.canopen.events import Fact
from drivers.canopen.heartbeat_watch import HeartbeatWatch
from drivers.canopen.settings import HEARTBEATS_MISSED
from tests.drivers.canopen.scripted_wire import dropped, restarted

PRE_OPERATIONAL, OPERATIONAL, STOPPED, BOOT_UP = 127, 5, 4, 0


@pytest.fixture
def watch():
    return HeartbeatWatch(3, timeout_s=0.25, heard_at=10.0)


def test_three_may_go_missing():
    assert HEARTBEATS_MISSED == 3


def test_silence_is_reported_once(watch):
    assert watch.check(10.25) is None
    assert watch.check(10.251) == Fact(Kind.SILENT, (3,))
    assert watch.check(10.3) is None


def test_silence_while_no_one_listened_is_no_loss(watch):
    watch.restart(20.0)
    assert watch.check(20.25) is None
    assert watch.check(20.251) == Fact(Kind.SILENT, (3,))
    watch.restart(30.0)
    assert watch.lost, "what was lost before must be heard first"


def test_a_heartbeat_that_comes_back_can_be_lost_again(watch):
    watch.check(11.0)
    assert watch.on_heartbeat(OPERATIONAL, 12.0) is None
    assert watch.check(12.25) is None
    assert watch.check(12.3) == Fact(Kind.SILENT, (3,))


@pytest.mark.parametrize(
    ("heard", "reported", "forgot"),
    [
        ([], [], False),
        ([OPERATIONAL, OPERATIONAL], [], False),
        ([OPERATIONAL, PRE_OPERATIONAL, PRE_OPERATIONAL], [dropped(3)], True),
        ([OPERATIONAL, STOPPED], [dropped(3, 4)], True),
        # The first ones may have been sent before NMT start came.
        ([PRE_OPERATIONAL, PRE_OPERATIONAL, OPERATIONAL], [], False),
        ([PRE_OPERATIONAL, OPERATIONAL, PRE_OPERATIONAL], [dropped(3)], True),
        ([BOOT_UP], [restarted(3)], True),
        ([OPERATIONAL, BOOT_UP, PRE_OPERATIONAL], [restarted(3)], True),
        ([OPERATIONAL, STOPPED, OPERATIONAL, STOPPED], [dropped(3, 4)] * 2, True),
        # Operational again by another master: it does not hold what was written, all the same.
        ([OPERATIONAL, STOPPED, OPERATIONAL], [dropped(3, 4)], True),
        # Node guarding toggles bit 7.
        ([OPERATIONAL | 0x80, OPERATIONAL], [], False),
    ],
)
def test_states(watch, heard, reported, forgot):
    events = [watch.on_heartbeat(state, 10.0 + 0.05 * k) for k, state in enumerate(heard)]
    assert [event for event in events if event] == reported
    assert watch.forgot is forgot
    assert watch.operational is (heard[-1:] in ([OPERATIONAL], [OPERATIONAL | 0x80]))
    assert watch.lost is False
