"""Causes on the bus behind the condition that is found first: named beside it, with the drive."""

from collections.abc import Iterator

import pytest

from bench.rigs.breakable_arm import DESK, ROMEO_ARM, BreakableArm, Make, restore, stage, start
from bench.rigs.bus_faults import flooded_and_unheard, two_drives
from bench.rigs.drive_faults import supply_gone
from daemon.faults.conditions import Condition
from daemon.faults.finding import advice_on
from daemon.faults.symptoms import advice_of
from daemon.modes.table import Event, Mode
from drivers.canopen.ids import SDO_REQUEST
from simulator.state_machine import Trigger


@pytest.fixture(params=[ROMEO_ARM, DESK], ids=lambda make: make.name)
def on(request: pytest.FixtureRequest) -> Iterator[BreakableArm]:
    make: Make = request.param
    with stage(make) as on:
        yield on


on_one_make = pytest.mark.parametrize("on", [DESK], ids=[DESK.name], indirect=True)


def cause(on: BreakableArm) -> str:
    return on.rig.tick.controller.machine.cause


def test_a_drive_that_misses_the_master_on_a_flooded_bus_names_the_load(on: BreakableArm) -> None:
    start(on, armed=True)
    for _ in flooded_and_unheard(on):
        on.tick()
    assert cause(on).startswith(f"{Condition.UNHEARD}: node {on.drive.node} ({on.drive.name}): ")
    assert "bus load at least " in cause(on)
    assert cause(on).endswith(" unknown frames/s, 0x123 among them)")
    assert advice_on(cause(on)) == advice_of(Condition.UNHEARD)
    on.run(0.2)
    on.rig.reset()
    assert all("taken" not in str(finding) for finding in on.rig.last.findings)


def test_a_drive_that_misses_the_master_on_a_quiet_bus_is_named_alone(on: BreakableArm) -> None:
    start(on, armed=True)
    on.simulated.lock()
    on.tick()
    assert cause(on).startswith(Condition.UNHEARD)
    assert "taken" not in cause(on)


def test_two_drives_are_named_before_the_arm_is_enabled(on: BreakableArm) -> None:
    going = two_drives(on)
    for _ in range(8):
        next(going)
        on.tick()
    who = f"node {on.drive.node} ({on.drive.name})"
    assert cause(on) == f"{Condition.TWO_DRIVES}: {who}: two drives answer as this node"
    going.close()  # type: ignore[attr-defined]
    on.run(0.5)  # without power a link falls through its gap; then all were seen to stand
    on.rig.reset()


@pytest.mark.parametrize(
    ("trigger", "condition", "how"),
    [
        (Trigger.DISABLE_VOLTAGE, Condition.SUPPLY_LOST, " is in switch on disabled"),
        (Trigger.FAULT_DETECTED, Condition.DRIVE_FAULT, ", without supply"),
    ],
)
def test_a_drive_without_supply_is_named(
    on: BreakableArm, trigger: Trigger, condition: Condition, how: str
) -> None:
    start(on, armed=True)
    going = supply_gone(on)
    next(going)
    on.simulated.axis.happen(trigger)
    on.tick()
    assert cause(on) == f"{condition}: {on.drive.name}{how}"
    going.close()  # type: ignore[attr-defined]


def test_a_supply_that_is_off_while_the_arm_is_off_is_no_fault(on: BreakableArm) -> None:
    going = supply_gone(on)
    next(going)
    on.run(0.2)
    assert on.rig.mode is Mode.OFF
    assert on.rig.last.findings == ()
    going.close()  # type: ignore[attr-defined]


def silence_sdo(on: BreakableArm) -> None:
    on.simulated.on_sdo = lambda data: None  # type: ignore[method-assign]


@on_one_make
def test_arming_without_sdo_answers_is_refused_with_the_drive(on: BreakableArm) -> None:
    assert on.rig.ask(Event.ENABLE) == []
    on.run(1.2)
    assert on.rig.permit() == []
    on.rig.tick.controller.disarm("the bench", on.rig.time_s)
    silence_sdo(on)
    on.run(5.5)
    assert on.rig.mode is Mode.HOLDING
    (reason,) = on.rig.permit()
    assert reason.startswith(f"no SDO answer from {on.drive.name}: ")
    del on.simulated.on_sdo
    on.run(5.5)
    assert on.rig.permit() == []


def test_a_drive_without_sdo_answers_is_named_by_enable(on: BreakableArm) -> None:
    silence_sdo(on)
    (reason,) = on.rig.ask(Event.ENABLE)
    assert f"node {on.drive.node} ({on.drive.name}) does not answer (SDO timeout" in reason
    assert on.rig.mode is Mode.OFF


@on_one_make
def test_no_sdo_request_is_sent_while_the_arm_moves_or_is_armed(on: BreakableArm) -> None:
    def asked() -> set[int]:
        return {cob_id for cob_id, _ in on.wire.sent if cob_id & ~0x7F == SDO_REQUEST}

    start(on, armed=True)
    for _ in range(600):
        on.tick()
        assert not asked()
    on.rig.request(Event.STOP)
    on.run(0.5)
    assert on.rig.mode is Mode.HOLDING
    on.rig.tick.controller.machine.arm("the bench")
    on.tick()
    for _ in range(600):
        on.tick()
        assert not asked(), "armed"
    on.rig.tick.controller.disarm("the bench", on.rig.time_s)
    found: set[int] = set()
    for _ in range(20):
        on.tick()
        found |= asked()
    assert found == {SDO_REQUEST + drive.node for drive in on.drives}
    restore(on)
