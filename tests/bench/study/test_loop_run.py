"""Foundations of `bench.loop`: recorded drives, and figures from histograms."""

import can
import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from bench.study.loop_session import RecordedDrives
from bench.study.wakeups import Distribution
from drivers.can.virtual import QueueWire

SYNC, SETPOINT = (0x080, b""), (0x201, bytes(6))


def test_recorded_drives_answer_each_sync_and_play_the_steady_part_over_and_over() -> None:
    answers = [
        (can.Message(arbitration_id=0x181, is_extended_id=False, data=[tick]),) for tick in range(4)
    ]
    with can.Bus(interface="virtual", channel="recorded") as near:
        times = iter([0.0, 0.0, 0.01, 0.021, 0.029, 0.04, 0.06, 0.07, 0.12])
        drives = RecordedDrives(near, answers, 2, 0.01, lambda: next(times))
        near.channel.append(drives)
        wire = QueueWire(near)
        heard = []
        for _ in range(8):
            wire.send([SETPOINT, SYNC])
            heard += [data[0] for _, data in iter(lambda: wire.receive(0.0), None)]
        near.channel.remove(drives)
    # One SYNC is left out, and later four.
    assert heard == [0, 1, 2, 3, 2, 2, 3, 2]
    assert drives.cpu_s > 0.0


@pytest.mark.parametrize(
    ("percent", "value"), [(0, 10.0), (50, 10.0), (50.1, 20.0), (99, 20.0), (99.1, 5000.0)]
)
def test_percentiles_of_a_histogram(percent: float, value: float) -> None:
    of = Distribution(np.array([10.0, 20.0, 5000.0]), np.array([50, 49, 1]))
    assert of.at(percent) == value


def test_what_is_beyond_a_limit_is_counted_without_the_limit_itself() -> None:
    of = Distribution(np.array([10.0, 20.0, 5000.0]), np.array([50, 49, 1]))
    assert [of.beyond(limit) for limit in (9.0, 10.0, 20.0, 5000.0)] == [100, 50, 1, 0]


def test_in_lockstep_both_ends_have_the_configured_period() -> None:
    with lockstep_rig(
        SINGLE_JOINT, configure=lambda c: msgspec.structs.replace(c, period_ms=4)
    ) as rig:
        before = rig.arm.now
        rig.run(0.04)
        assert rig.ticks == 10
        assert rig.arm.now - before == pytest.approx(0.04)
