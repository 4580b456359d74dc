"""TPDOs that count as the answer to a SYNC."""

import numpy as np
import pytest

from drivers.api import DriveCondition, Kind
from drivers.awaited import START_TICKS
from drivers.canopen.drives import CanopenDrives
from drivers.canopen.emergency_codes import UNKNOWN_CODE
from drivers.canopen.events import Emergency, Fact
from drivers.canopen.outbox import SYNC_FRAME
from tests.drivers.canopen.scripted_wire import PERIOD_S, N, crossed, everything, frame, tick, tpdos


def test_reading_ends_with_the_last_tpdo(scripted, drives):
    late = frame(0x703, b"\x05")
    samples = tick(drives, scripted, [*everything(), late])
    assert samples.fresh.all()
    assert scripted.incoming == [late]
    np.testing.assert_allclose(samples.current, [1.0, 0.75, 0.6, 0.6, 0.3, 0.15, 0.15])


def test_reading_waits_until_the_deadline_and_no_longer(scripted, joint_drives):
    times = iter([0.0, 0.0, 0.0, 0.001, 0.004])
    drives = CanopenDrives(scripted, joint_drives, PERIOD_S, lambda: next(times))
    drives.start(0.0)
    drives.sync(0.0)
    scripted.waits.clear()
    scripted.incoming += tpdos(1)
    drives.collect(0.003)
    assert scripted.waits == pytest.approx([0.003, 0.002, 0.0])


def test_a_joint_is_fresh_when_all_its_tpdos_are_in(scripted, drives):
    samples = tick(drives, scripted, everything())
    position = samples.link_position.copy()
    for age in (1, 2):
        one_missing = [message for message in everything() if message.arbitration_id != 0x283]
        samples = tick(drives, scripted, one_missing, (1 + age) * PERIOD_S)
        assert list(samples.fresh) == [i != 2 for i in range(N)]
        assert list(samples.age_s) == [age * PERIOD_S if i == 2 else 0 for i in range(N)]
        np.testing.assert_array_equal(samples.link_position, position)
    samples = tick(drives, scripted, everything(), 4 * PERIOD_S)
    assert samples.fresh.all()
    assert not samples.age_s.any()


def test_a_late_tpdo_does_not_pass_for_the_next(scripted, drives):
    tick(drives, scripted, everything())
    tick(drives, scripted, everything()[1:], 2 * PERIOD_S)
    scripted.incoming += everything()[:1]  # comes after the deadline, before the next SYNC
    samples = tick(drives, scripted, everything()[1:], 3 * PERIOD_S)
    assert not samples.fresh[0]
    assert list(samples.age_s[:2]) == [2 * PERIOD_S, 0]


def test_the_arm_recovers_at_once_from_drives_that_were_late(scripted, drives):
    fresh = []
    for k in range(1, 31):
        late = 10 < k <= 20
        samples = tick(drives, scripted, [] if late else everything(), k * PERIOD_S)
        fresh.append(bool(samples.fresh.all()))
        if late:
            scripted.incoming += everything()
    assert fresh == [True] * 10 + [False] * 10 + [True] * 10


def test_short_frames_are_not_believed(scripted, drives):
    samples = tick(drives, scripted, [frame(0x181, b"\x27"), frame(0x703)])
    assert samples.drives[0].condition is DriveCondition.UNKNOWN
    assert samples.events == ()


@pytest.mark.parametrize(
    ("data", "code", "words"),
    [
        (b"\x10\x23", 0x2310, "0x2310 (over-current), error register 0x00"),
        (b"\x10", UNKNOWN_CODE, "unknown code, the message is truncated"),
        (b"", UNKNOWN_CODE, "unknown code, the message is truncated"),
    ],
)
def test_an_emergency_that_is_cut_short_is_one(scripted, drives, data, code, words):
    samples = tick(drives, scripted, [frame(0x83, data)])
    assert samples.events == crossed(Emergency(3, code, 0))
    assert samples.events[0].text.endswith(f": {words}")


def test_an_answer_that_comes_twice_for_one_sync_was_old(scripted, drives):
    tick(drives, scripted, everything())
    tick(
        drives, scripted, everything()[1:], 2 * PERIOD_S
    )  # the first comes more than a period late
    late = tick(drives, scripted, everything(), 3 * PERIOD_S)  # here it is, taken for the third
    assert late.events == ()
    scripted.incoming += everything()[:1]  # and here is the third
    assert tick(drives, scripted, everything(), 4 * PERIOD_S).events == crossed(
        Fact(Kind.DISTURBED, (1,), "answers more than a period late")
    )
    assert tick(drives, scripted, everything(), 5 * PERIOD_S).events == ()


def test_what_came_before_the_first_sync_is_nobodys_late_answer(scripted, drives):
    scripted.incoming += everything()
    assert tick(drives, scripted, everything()).events == ()


def test_a_bus_that_returns_with_old_frames_gives_no_sample_of_before(scripted, drives):
    tick(drives, scripted, everything())
    scripted.incoming += 40 * everything(0x27)  # more than one pass reads
    samples = tick(drives, scripted, everything(0x08), 2 * PERIOD_S)
    assert not samples.fresh.any(), "all that was read may be old"
    samples = tick(drives, scripted, everything(0x08), 3 * PERIOD_S)
    assert samples.fresh.all()
    assert {drive.condition for drive in samples.drives} == {DriveCondition.FAILED}


def test_a_drive_on_its_way_is_awaited_for_a_while_and_its_samples_age(scripted, drives):
    """No drive has answered since SYNC is sent again: what is known is old, and no fault yet."""
    for k in range(1, START_TICKS + 3):
        here = [message for message in everything() if k > 2 and message.arbitration_id != 0x283]
        scripted.sent.clear()
        samples = tick(drives, scripted, here, k * PERIOD_S)
        if SYNC_FRAME not in scripted.sent:
            continue  # it was left out, to see whether those that came late answer late
        on_their_way = [k <= START_TICKS and (i == 2 or k <= 2) for i in range(N)]
        assert list(samples.starting) == on_their_way
        assert list(samples.age_s) == [k * PERIOD_S if i == 2 or k <= 2 else 0 for i in range(N)]
    samples = tick(drives, scripted, everything(), k * PERIOD_S)
    samples = tick(drives, scripted, [], k * PERIOD_S)
    assert not samples.starting.any(), "they were there"
