"""Zero that another master gives a RobStride motor that holds: an old setpoint would throw it."""

from collections.abc import Iterator

import can
import pytest

from bench.rigs.lines import LockstepBus
from bench.rigs.lockstep import BEAM, Rig, lockstep_rig
from common.errors import DriveError
from daemon.faults.conditions import Condition
from daemon.modes.table import Mode
from drivers.can.wire import IDENTIFIER
from drivers.robstride.frames import Kind, identifier
from tests.drivers.motors.one_arm import cause, furthest, hold_at, powered, without_the_daemon

JOINT = 1
SAGS = 0.08  # [rad]: the motor takes its new 0 for p until the next setpoint
ZERO = identifier(Kind.ZERO, 0xAA, JOINT + 1) & IDENTIFIER


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(BEAM) as rig:
        yield rig


def zero(rig: Rig) -> None:
    with LockstepBus(rig.line.channel) as other:
        other.send(can.Message(0.0, ZERO, True, data=b"\x01" + bytes(7)))


@pytest.mark.parametrize("at", [0.5, -1.0])
def test_a_motor_that_gets_another_zero_stays_where_it_is(rig: Rig, at: float) -> None:
    hold_at(rig, {"joint2": at})
    zero(rig)
    assert furthest(rig, 2.0).max() < SAGS
    assert abs(rig.samples.motor_position[JOINT]) < SAGS
    assert rig.mode is Mode.FAULTED
    assert cause(rig).startswith(Condition.FOREIGN_MASTER)
    assert all(powered(rig))
    with pytest.raises(DriveError, match="joint2"):
        rig.drives.prove(lambda: None, str, str)


def test_a_motor_that_gets_another_zero_without_a_daemon_is_held_by_the_guardian(rig: Rig) -> None:
    hold_at(rig, {"joint2": -1.0})
    without_the_daemon(rig, 0.3)
    zero(rig)
    assert without_the_daemon(rig, 1.0).max() < SAGS
    assert all(powered(rig))
