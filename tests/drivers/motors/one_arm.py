"""Arm of simulated motors in the whole program, behind a wire that loses or adds frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.rigs.lockstep import BEAM, OPENARM, Rig, lockstep_rig
from common.arrays import Vector
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import Go
from daemon.service.poses import Poses
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import Status
from drivers.robstride.frames import setpoint_id
from simulator.robstride.motor import RUN

T = 0.01
RAISED = {"joint1": -0.9, "joint2": -0.5, "joint4": 0.9}
"""Pose of the OpenArm in which gravity pulls at every large joint."""


@dataclass(frozen=True)
class Make:
    """One make of motors: an arm of them, and how a simulated motor shows its state."""

    name: str
    folder: Path
    joint: int  # which bears a load
    powered: int  # status of a motor with power
    fault: str  # attribute that holds a motor's fault
    setpoint: Callable[[int], int]  # identifier of a motor's setpoints

    def __str__(self) -> str:
        return self.name


DAMIAO = Make("damiao", OPENARM, 3, Status.ENABLED, "status", lambda motor: motor)
ROBSTRIDE = Make("robstride", BEAM, 1, RUN << 6, "faults", setpoint_id)


class Filter:
    """Wire that passes the frames of which `passes` is true; both directions."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.passes: Callable[[int, bytes], bool] = lambda can_id, data: True
        self.more: list[Frame] = []
        self.sent: list[tuple[int, bytes]] = []

    def receive(self, timeout: float) -> Frame | None:
        """The next frame that passes."""
        if self.more:
            return self.more.pop(0)
        while (frame := self.wire.receive(timeout)) is not None:
            if self.passes(frame[0], bytes(frame[1])):
                return frame
        return None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send those that pass."""
        self.sent = [(can_id, bytes(data)) for can_id, data in frames]
        self.wire.send([frame for frame in self.sent if self.passes(*frame)])


class Filtered:
    """A rig with its filter."""

    rig: Rig
    filter: Filter


def filtered(make: Make) -> Iterator[Filtered]:
    """A rig of this make, off."""
    arm = Filtered()

    def between(wire: Wire) -> Filter:
        arm.filter = Filter(wire)
        return arm.filter

    with lockstep_rig(make.folder, between=between) as arm.rig:
        yield arm


def hold_at(rig: Rig, targets: dict[str, float]) -> None:
    """Enable the arm, and let it hold at these positions [rad]."""
    rig.enable()
    path = Poses(rig.robot).path(Go(targets=targets), rig.samples.link_position)
    assert not rig.tick.controller.request(Event.START, "the test", rig.time_s, path)
    rig.run(9.0)
    assert rig.mode is Mode.HOLDING


def furthest(rig: Rig, seconds: float) -> Vector:
    """Furthest way of each link [rad] in so many seconds."""
    begun, most = rig.arm.plant.q.copy(), np.zeros(rig.arm.plant.n)
    rig.run(seconds, lambda: np.maximum(most, np.abs(rig.arm.plant.q - begun), out=most))
    return most


def without_the_daemon(rig: Rig, seconds: float) -> Vector:
    """The same, while no daemon ticks."""
    begun, most = rig.arm.plant.q.copy(), np.zeros(rig.arm.plant.n)
    for _ in range(round(seconds / T)):
        rig.arm.advance(rig.arm.now + T)
        rig.guard()
        rig.lockstep.pump()
        np.maximum(most, np.abs(rig.arm.plant.q - begun), out=most)
    return most


def powered(rig: Rig) -> list[bool]:
    """True for motors with power."""
    make = next(make for make in (DAMIAO, ROBSTRIDE) if make.folder == rig.robot.path.parent)
    return [motor.status == make.powered for motor in rig.arm.motors]


def cause(rig: Rig) -> str:
    """Cause of the daemon's mode."""
    return str(rig.tick.controller.machine.cause)


def stands(rig: Rig) -> bool:
    """True if no motor moves."""
    return bool(np.abs(rig.arm.plant.theta_dot).max() < 0.02)
