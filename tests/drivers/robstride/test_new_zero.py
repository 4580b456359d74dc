"""Zero that another master gives a RobStride motor that holds: an old setpoint would throw it."""

import can
import numpy as np
import pytest

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lockstep import BEAM, lockstep_rig
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Go
from daemon.service.poses import Poses
from drivers.can.wire import IDENTIFIER
from drivers.robstride.frames import Kind, identifier
from simulator.robstride.motor import RUN
from tests.drivers.damiao.test_arm import cause

JOINT = 1
SAGS = 0.08  # [rad]: the motor takes its new 0 for p until the next setpoint


@pytest.mark.parametrize("at", [0.5, -1.0])
def test_a_motor_that_gets_another_zero_stays_where_it_is(at: float) -> None:
    with lockstep_rig(BEAM) as rig:
        rig.enable()
        path = Poses(rig.robot).path(Go(targets={"joint2": at}), rig.samples.link_position)
        assert not rig.tick.controller.request(Event.START, "the test", rig.time_s, path)
        rig.run(9.0)
        assert rig.mode is Mode.HOLDING
        begun, furthest = rig.arm.plant.q.copy(), [0.0]
        assert isinstance(rig.guard, GuardianAtBus)
        zero = identifier(Kind.ZERO, 0xAA, JOINT + 1) & IDENTIFIER
        rig.guard.end.send(can.Message(0.0, zero, True, data=b"\x01" + bytes(7)))

        def each() -> None:
            furthest[0] = max(furthest[0], float(np.abs(rig.arm.plant.q - begun).max()))

        rig.run(2.0, each)
        assert abs(rig.samples.motor_position[JOINT]) < SAGS
        assert furthest[0] < SAGS
        assert rig.mode is Mode.FAULTED
        assert cause(rig).startswith(Condition.FOREIGN_MASTER)
        assert all(motor.mode == RUN for motor in rig.arm.motors)
