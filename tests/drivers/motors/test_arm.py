"""Arm of motors of every make in the whole program, against simulated motors that fail."""

import pytest

from common.errors import SilentDriveError
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from drivers.robstride.frames import Kind, identifier
from simulator.damiao import motor as damiao
from simulator.robstride import motor as robstride
from tests.drivers.motors.one_arm import DAMIAO, ROBSTRIDE, Filtered, Make, cause, powered, stands


@pytest.fixture(params=[DAMIAO, ROBSTRIDE], ids=str)
def make(request: pytest.FixtureRequest) -> Make:
    made: Make = request.param
    return made


def test_a_silent_motor_is_named(arm: Filtered) -> None:
    arm.rig.arm.motors[4].silent = True
    with arm.rig.lockstep.serving(), pytest.raises(SilentDriveError, match="joint5"):
        arm.rig.drives.boot_up(lambda line: None)


@pytest.mark.parametrize(("make", "at_once"), [(DAMIAO, True), (ROBSTRIDE, False)], ids=str)
def test_a_stop_is_a_ramp_that_is_proved(moving: Filtered, at_once: bool) -> None:
    rig = moving.rig
    if at_once:
        rig.drives.quick_stop()
    rig.request(Event.STOP)
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    assert stands(rig)
    assert rig.drives.unproved() == ()


@pytest.mark.parametrize(
    ("make", "fault", "condition"),
    [
        (DAMIAO, damiao.OVERLOAD, Condition.EMERGENCY),
        (DAMIAO, damiao.LOST, Condition.UNHEARD),
        (ROBSTRIDE, robstride.UNDER_VOLTAGE, Condition.EMERGENCY),
        (ROBSTRIDE, robstride.OVERLOAD, Condition.EMERGENCY),
    ],
    ids=str,
)
def test_a_motor_in_fault_stops_the_arm_until_a_reset(
    moving: Filtered, make: Make, fault: int, condition: Condition
) -> None:
    rig = moving.rig
    rig.arm.motors[5].fail(fault)
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(condition)
    assert getattr(rig.arm.motors[5], make.fault) == fault  # nothing is cleared by itself
    assert rig.ask(Event.ENABLE)
    rig.reset()
    rig.enable()
    assert all(powered(rig))


def test_a_motor_that_falls_silent_stops_the_arm_and_is_commanded_on(
    moving: Filtered, make: Make
) -> None:
    rig = moving.rig
    rig.arm.motors[0].silent = True
    rig.run(1.0)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.STALE)
    assert "joint1" in cause(rig)
    assert all(powered(rig)[1:])
    assert make.setpoint(1) in [can_id for can_id, _ in moving.filter.sent]  # it may receive
    assert "joint1" in rig.drives.unproved()
    rig.arm.motors[0].silent = False
    rig.run(1.0)
    rig.reset()
    rig.enable()


def test_a_motor_that_restarts_in_motion_stops_the_arm(moving: Filtered, make: Make) -> None:
    rig = moving.rig
    rig.arm.motors[make.joint].boot()
    rig.run(0.5)
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.REBOOTED)
    assert not powered(rig)[make.joint]  # it is not enabled unset
    rig.run(1.5)
    rig.reset()
    rig.enable()


#: 6 is a new zero, 7 a new id, 22 keeps parameters, 25 is another protocol.
KINDS = [Kind.SETPOINT, Kind.ENABLE, Kind.STOP, Kind.WRITE, 6, 7, 22, 25]


@pytest.mark.parametrize(
    ("make", "can_id"),
    [(DAMIAO, 1 + DAMIAO.joint)]
    + [(ROBSTRIDE, identifier(kind, 0xAA, 1 + ROBSTRIDE.joint)) for kind in KINDS],
    ids=str,
)
def test_another_master_stops_the_arm(moving: Filtered, can_id: int) -> None:
    moving.filter.more.append((can_id, bytes(8)))
    moving.rig.run(0.2)
    assert moving.rig.mode is Mode.FAULTED
    assert cause(moving.rig).startswith(Condition.FOREIGN_MASTER)
