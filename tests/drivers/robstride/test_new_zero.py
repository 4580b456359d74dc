"""Zero that another master gives a RobStride motor that holds: an old setpoint would throw it."""

from collections.abc import Iterator

import can
import pytest

from bench.rigs.lines import LockstepBus
from bench.rigs.lockstep import BEAM, Rig, lockstep_rig
from common.errors import DriveError
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Go
from daemon.service.poses import Poses
from drivers.can.wire import IDENTIFIER
from drivers.robstride.frames import Kind, identifier
from simulator.robstride.motor import RUN
from tests.drivers.damiao.test_arm import cause
from tests.drivers.damiao.test_false_feedback import furthest
from tests.drivers.robstride.test_arm import without_the_daemon

JOINT = 1
SAGS = 0.08  # [rad]: the motor takes its new 0 for p until the next setpoint
ZERO = identifier(Kind.ZERO, 0xAA, JOINT + 1) & IDENTIFIER


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(BEAM) as rig:
        rig.enable()
        yield rig


def held_at(rig: Rig, at: float) -> None:
    path = Poses(rig.robot).path(Go(targets={"joint2": at}), rig.samples.link_position)
    assert not rig.tick.controller.request(Event.START, "the test", rig.time_s, path)
    rig.run(9.0)
    assert rig.mode is Mode.HOLDING


def zero(rig: Rig) -> None:
    with LockstepBus(rig.line.channel) as other:
        other.send(can.Message(0.0, ZERO, True, data=b"\x01" + bytes(7)))


@pytest.mark.parametrize("at", [0.5, -1.0])
def test_a_motor_that_gets_another_zero_stays_where_it_is(rig: Rig, at: float) -> None:
    held_at(rig, at)
    zero(rig)
    assert furthest(rig, 2.0) < SAGS
    assert abs(rig.samples.motor_position[JOINT]) < SAGS
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.FOREIGN_MASTER)
    assert all(motor.mode == RUN for motor in rig.arm.motors)
    with pytest.raises(DriveError, match="joint2"):
        rig.drives.prove(lambda: None, str, str)


def test_one_that_gets_it_while_no_daemon_runs_is_held_by_the_guardian(rig: Rig) -> None:
    held_at(rig, -1.0)
    without_the_daemon(rig, 0.3)
    zero(rig)
    assert without_the_daemon(rig, 1.0) < SAGS
    assert all(motor.mode == RUN for motor in rig.arm.motors)
