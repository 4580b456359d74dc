"""Arm of one durand drive, as a rig like that of the simulated arms: faults on another stack.

It has what its one joint can show, under the names that the simulated arms have.
"""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import cast

import msgspec
import numpy as np

from bench.rigs.durand_drive import DurandDrive
from bench.rigs.lines import OpenLine, virtual_line
from bench.rigs.lockstep import SINGLE_JOINT, TRUSTED, Rig
from bench.rigs.sync_clock import Lockstep
from common.arrays import Vector
from daemon.assembly import build_arming_checks, build_tick
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.drives import build_boot, build_canopen
from drivers.can.wire import Wire
from drivers.canopen.boot.data_sheet import load_data_sheet
from simulator.arm import SimulatedArm
from simulator.sensors import Readings
from simulator.state_machine import State, Trigger


def stiff_robot() -> Robot:
    """A single joint without a gap, as the drive's motor has none."""
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration
    joint = msgspec.structs.replace(c.joints[0], half_gap=0.0)
    return replace(robot, configuration=msgspec.structs.replace(c, joints=[joint]))


def load_of(robot: Robot) -> Callable[[float, float], float]:
    """Torque [Nm] of gravity and friction on the motor at position [rad] and velocity [rad/s]."""
    c = robot.configuration
    friction, gravity = c.joints[0].friction, robot.model.gravity
    coulomb = friction.motor_coulomb + friction.link_coulomb
    viscous = friction.motor_viscous + friction.link_viscous

    def torque(q: float, velocity: float) -> float:
        rub = coulomb * np.tanh(velocity / 0.02) + viscous * velocity
        return float(gravity(np.array([q]))[0] + rub)

    return torque


class _Drive:
    """Durand drive with the parts of a simulated drive, and of its axis."""

    def __init__(self, drive: DurandDrive) -> None:
        self._drive, self.axis = drive, self
        self.node = drive.number

    @property
    def state(self) -> State:
        return State[self._drive.state.replace(" ", "_")]

    def fault(self, code: int, _: str) -> None:
        self._drive.fail(code)

    def boot(self) -> None:
        self._drive.power_on()

    def lock(self) -> None:
        self._drive.lock()

    def on_sdo(self, data: bytes) -> None:
        self._drive.hear(0x600 + self.node, data)

    def put(self, index: int, subindex: int, value: int) -> None:
        self._drive.objects.write(index, subindex, value)

    def on_nmt(self, command: int) -> None:
        self._drive.hear(0, bytes([command, 0]))

    def happen(self, trigger: Trigger) -> None:
        assert trigger is Trigger.DISABLE_VOLTAGE
        self._drive.switch_off()


class _Plant:
    """Plant of one joint whose motor and link are one."""

    def __init__(self, drive: DurandDrive) -> None:
        self._drive = drive

    @property
    def q(self) -> Vector:
        return np.array([self._drive.q])

    @property
    def theta(self) -> Vector:
        return self.q

    @property
    def theta_dot(self) -> Vector:
        return np.array([self._drive.velocity])

    def place(self, q: Vector) -> None:
        self._drive.q = float(q[0])


class DurandArm:
    """Arm of one durand drive, with the parts of a `SimulatedArm` that its joint can show."""

    def __init__(self, drive: DurandDrive, period_s: float) -> None:
        self._drive, self._period_s = drive, period_s
        self.plant, self.drives = _Plant(drive), [_Drive(drive)]
        self.now = 0.0
        self.serving, self.let_pass = drive.serving, drive.let_pass
        drive.network.on_sync = lambda: self.advance(self.now + period_s)

    @property
    def sense(self) -> Callable[[], Readings]:
        """`sense` of the drive."""
        return self._drive.sense

    @sense.setter
    def sense(self, sense: Callable[[], Readings]) -> None:
        self._drive.sense = sense

    def advance(self, t: float) -> None:
        """Let time pass until t [s], a tick at a time."""
        while self.now < t - 1e-9:
            self._drive.advance(self._period_s)
            self.now += self._period_s

    def pump(self) -> None:
        """Handle queued frames, like `Lockstep.pump`: every SYNC moves the arm on by a period."""
        self._drive.pump()


@contextmanager
def durand_rig(
    *,
    configure: Callable[[Configuration], Configuration] = lambda c: c,
    between: Callable[[Wire], Wire] = lambda wire: wire,
    line: OpenLine = virtual_line,
) -> Iterator[Rig]:
    """Rig like `lockstep_rig`, around one durand drive."""
    robot = stiff_robot()
    robot = replace(robot, configuration=configure(robot.configuration))
    c = robot.configuration
    with line() as bus, tempfile.TemporaryDirectory(prefix="durand-") as folder:
        drive = DurandDrive(bus.far, c.joint_drives[0].node, load_of(robot))
        eds = Path(folder) / "drive.eds"
        eds.write_text(drive.eds)
        boot = replace(build_boot(robot, bus.near.wire), listen_s=0.0, sleep=drive.let_pass)
        sheet = load_data_sheet(eds)
        boot.setups = [replace(setup, data_sheet=sheet) for setup in boot.setups]
        with drive.serving():
            boot.boot_up()
        bus.hand_over()
        drives = build_canopen(robot, boot, between(bus.wire), lambda: 0.0)
        tick = build_tick(robot, drives, TRUSTED)
        parts = drives, tick, build_arming_checks(robot, tick, TRUSTED)
        drives.start(0.0)
        arm = DurandArm(drive, c.period_s)
        arm.pump()
        arm_and_bus = cast(SimulatedArm, arm), cast(Lockstep, arm), bus
        yield Rig(robot, *parts, *arm_and_bus, lambda _: parts)
