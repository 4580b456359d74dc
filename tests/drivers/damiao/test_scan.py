"""Scan of a bus for Damiao motors, and its table."""

import can
import pytest

from bench.rigs.lines import virtual_line
from bench.rigs.lockstep import OPENARM
from bench.rigs.sync_clock import AnsweredWire, Lockstep, at_request
from common.errors import BusError
from daemon.config.load import load_robot
from drivers.damiao.scan import scan_motors
from programs.contactd.scan import motor_table
from programs.simulate.simulated_robot import true_arm
from simulator.arm import SimulatedArm

RANGES = {1: "45", 3: "10", 5: "30"}


def test_motors_are_listed_as_a_profile_names_their_registers() -> None:
    robot = load_robot(OPENARM)
    description, simulation = true_arm(robot)
    with virtual_line() as bus:
        arm = SimulatedArm(description, simulation.settings, bus.far.send)
        lockstep = Lockstep(arm, bus.far, at_request(robot))
        arm.power_on()
        arm.motors[3].silent = True
        arm.motors[5].registers.values[7] = 0.0
        with lockstep.serving():
            found = scan_motors(AnsweredWire(bus.near.wire, lockstep))
    assert [one.motor for one in found] == [1, 2, 3, 5, 6, 7]
    assert [one.models for one in found[:3]] == [["DM8009"], ["DM8009"], ["DM4340"]]
    head, *lines = motor_table(found)
    assert "velocity_max" in head
    for line in lines[:6]:
        if line.split()[0] in "135":
            assert RANGES[int(line.split()[0])] in line.split()
    assert lines[-1] == "motor 6: register 7 (master id) must be 22"
    assert all(motor.status == 0 for motor in arm.motors)
    assert motor_table([]) == []


def test_it_is_refused_while_a_master_commands_motors() -> None:
    with virtual_line() as bus:
        bus.far.send(can.Message(arbitration_id=3, data=bytes(8), is_extended_id=False))
        with pytest.raises(BusError, match="0x003"):
            scan_motors(bus.near.wire)
