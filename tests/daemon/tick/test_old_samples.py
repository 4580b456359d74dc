"""Samples that are a period old: named, and no arming with them, whenever it began."""

from collections.abc import Iterator

import pytest

from bench.rigs.breakable_arm import DESK, ROMEO_ARM, BreakableArm, Make, stage
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from drivers.canopen.codec import transmit_pdos
from drivers.canopen.ids import SYNC
from drivers.punctuality import DOUBT_TICKS

OLD = Condition.OLD.value


@pytest.fixture(params=[ROMEO_ARM, DESK], ids=lambda make: make.name)
def on(request: pytest.FixtureRequest) -> Iterator[BreakableArm]:
    make: Make = request.param
    with stage(make) as on:
        on.run(0.1)
        yield on


def late(on: BreakableArm) -> list[int]:
    return [pdo.cob_id for pdo in transmit_pdos(on.drive)]


def test_samples_that_are_old_before_enable_are_found_after_it(on: BreakableArm) -> None:
    with on.delaying(*late(on)):
        assert on.rig.ask(Event.ENABLE) == []
        on.run(0.2)
        assert any(reason.startswith(OLD) for reason in on.rig.permit())
        assert on.rig.mode is not Mode.FAULTED
        assert on.drive.name in on.rig.arming.run(on.rig.time_s).checks[2].text


def test_arming_is_refused_until_late_answers_are_ruled_out(on: BreakableArm) -> None:
    """From the first answer that did not come, until it was looked at."""
    assert on.rig.ask(Event.ENABLE) == []
    on.run(1.0)
    assert on.rig.permit() == []
    on.rig.tick.controller.disarm("the bench", on.rig.time_s)
    with on.losing(*late(on)):
        on.tick()
    on.tick()
    for _ in range(DOUBT_TICKS):
        (reason,) = on.rig.permit()
        assert reason == f"still checking whether {on.drive.name} answers late: ask again"
        on.tick()
    assert all(cob_id != SYNC for cob_id, _ in on.wire.sent), "this one is left out"
    on.tick()
    on.run(0.5)
    assert on.rig.permit() == []


def test_a_bus_that_loses_frames_all_the_time_may_be_armed(on: BreakableArm) -> None:
    assert on.rig.ask(Event.ENABLE) == []
    on.run(1.0)
    granted = 0
    for tick in range(400):
        with on.losing(*late(on)) if tick % 17 == 5 else on.losing():
            on.tick()
        if tick > 100:
            granted += not on.rig.arming.run(on.rig.time_s).reasons
    assert granted > 200
    assert on.rig.mode is Mode.HOLDING
