"""Scan of a bus for RobStride motors, and its table."""

import can
import pytest

from bench.rigs.lines import virtual_line
from bench.rigs.lockstep import BEAM
from bench.rigs.sync_clock import AnsweredWire, Lockstep, at_request
from common.errors import BusError
from daemon.config.load import load_robot
from drivers.robstride.frames import Parameter
from drivers.robstride.scan import scan_motors
from drivers.robstride.settings import serial_of
from programs.contactd.scan import robstride_table
from programs.simulate.simulated_robot import true_arm
from simulator.arm import SimulatedArm


def test_motors_are_listed_with_what_a_configuration_needs() -> None:
    robot = load_robot(BEAM)
    description, simulation = true_arm(robot)
    with virtual_line() as bus:
        arm = SimulatedArm(description, simulation.settings, bus.far.send)
        lockstep = Lockstep(arm, bus.far, at_request(robot))
        arm.power_on()
        arm.motors[3].silent = True
        arm.motors[5]._turns = 6.2
        arm.motors[1].can_id = 1  # as delivered: two motors of one id
        with lockstep.serving():
            found = scan_motors(AnsweredWire(bus.near.wire, lockstep))
    assert [one.motor for one in found] == [1, 3, 5, 6]
    assert len(found[0].uids) == 2
    assert found[1].values[Parameter.TORQUE_LIMIT] == 14.0
    head, *lines = robstride_table(found)
    assert "torque limit in Nm" in head
    assert str(serial_of(found[1].uids[0])) in lines[1].split()
    assert lines[4].startswith("motor 6 counts from 0")
    assert lines[5] == "two motors answer with id 1"
    assert all(motor.mode == 0 for motor in arm.motors)
    assert robstride_table([]) == []


def test_it_is_refused_while_a_master_commands_motors() -> None:
    with virtual_line() as bus:
        bus.far.send(can.Message(arbitration_id=0x017FFF03, data=bytes(8), is_extended_id=True))
        with pytest.raises(BusError, match="0x017FFF03"):
            scan_motors(bus.near.wire)
