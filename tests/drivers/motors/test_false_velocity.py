"""False velocity: reported by a motor that stands, whose position and status are true."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.lockstep import BEAM, OPENARM, Rig, lockstep_rig
from daemon.modes.table import Mode
from drivers.api import DriveCondition
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import ANSWERS
from drivers.plausibility import Plausibility
from drivers.robstride.frames import Kind, kind_of, sender_of
from tests.drivers.motors.one_arm import Filter, furthest

JOINT = {OPENARM: 3, BEAM: 1}  # which bears a load
LOAD = {OPENARM: 0.0, BEAM: 4.0}  # [Nm]
STILL = 0.002  # [rad]
WAY = 0.2  # [rad]
MOST = {OPENARM: 0xFFF, BEAM: 0xFFFF}  # counts of a velocity
FASTEST = {OPENARM: 10.0, BEAM: 44.0}  # [rad/s]


class Falsified:
    """Wire that replaces the velocity of the next so many feedbacks of a motor, and moves its
    position."""

    def __init__(self, wire: Wire, arm: Path) -> None:
        self.wire, self.send, self.arm = wire, wire.send, arm
        self.left, self.velocity, self.way = 0, 0.0, 0.0

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, or what replaces it."""
        frame = self.wire.receive(timeout)
        if not frame or not self.left or not self._own(frame):
            return frame
        self.left -= 1
        most, fastest = MOST[self.arm], FASTEST[self.arm]
        data, counts = bytearray(frame[1]), round((self.velocity / fastest + 1.0) / 2.0 * most)
        if self.arm == OPENARM:
            data[3], data[4] = counts >> 4, (counts & 0xF) << 4 | data[4] & 0xF
        else:
            moved = int.from_bytes(data[:2], "big") + round(self.way / (8.0 * math.pi) * 0xFFFF)
            data[:4] = moved.to_bytes(2, "big") + counts.to_bytes(2, "big")
        return frame[0], bytes(data)

    def _own(self, frame: Frame) -> bool:
        number = JOINT[self.arm] + 1
        if self.arm == OPENARM:
            return frame[0] == number + ANSWERS and frame[1][2] not in (0x33, 0x55)
        return kind_of(frame[0]) == Kind.FEEDBACK and sender_of(frame[0]) == number


@pytest.fixture(params=[OPENARM, BEAM], ids=["damiao", "robstride"])
def held(request: pytest.FixtureRequest) -> Iterator[tuple[Rig, Falsified, int]]:
    wires: list[Falsified] = []

    def between(wire: Wire) -> Filter:
        wires.append(Falsified(wire, request.param))
        return Filter(wires[-1])

    with lockstep_rig(request.param, between=between) as rig:
        rig.enable()
        rig.arm.external_torque[JOINT[request.param]] = LOAD[request.param]
        rig.run(1.0)
        yield rig, wires[0], JOINT[request.param]


@pytest.mark.parametrize("velocity", [2.0, -6.0])
@pytest.mark.parametrize("frames", [2, 60, 400])
def test_a_false_velocity_cuts_no_power_and_moves_nothing(
    held: tuple[Rig, Falsified, int], velocity: float, frames: int
) -> None:
    rig, wire, joint = held
    wire.velocity, wire.left = velocity, frames
    assert furthest(rig, 3.0).max() < STILL
    # A motor whose velocity is its link's too shows an implausible residual in the first frames.
    at_once = wire.arm == BEAM and velocity < -2.0
    assert rig.mode is (Mode.HOLDING if frames == 2 and not at_once else Mode.FAULTED)
    assert rig.samples.drives[joint].condition.powered


@pytest.mark.parametrize("held", [BEAM], ids=["robstride"], indirect=True)
@pytest.mark.parametrize("frames", [2, 10, 400])
def test_a_false_position_that_the_output_contradicts_moves_a_joint_little(
    held: tuple[Rig, Falsified, int], frames: int
) -> None:
    rig, wire, joint = held
    # It fits the first step there, and not that the motor stays.
    wire.velocity, wire.way, wire.left = WAY / 0.01, WAY, frames
    assert furthest(rig, 3.0).max() < 0.03 < WAY
    assert rig.mode is Mode.FAULTED
    assert rig.samples.drives[joint].condition is DriveCondition.STOPPED


@pytest.mark.parametrize("seed", range(20))
def test_a_true_velocity_that_is_filtered_and_of_another_moment_parts_from_no_position(
    seed: int,
) -> None:
    draw = np.random.default_rng(seed)
    lag_s, period_s = draw.uniform(0.0, 0.012), 0.01
    plausible = Plausibility([0.03])
    position = velocity = reported = 0.0
    wanted, admitted = 0.0, 0
    for tick in range(4000):
        plausible.begin_tick()
        if tick % 50 == 0:
            wanted = draw.uniform(-8.0, 8.0)
        for _ in range(10):
            velocity += np.clip(wanted - velocity, -0.03, 0.03)  # 30 rad/s2
            position += velocity * period_s / 10
            reported += (velocity - reported) * min(period_s / 10 / max(lag_s, 1e-3), 1.0)
        late = velocity * draw.uniform(0.0, 0.003)
        if draw.uniform() < 0.95:
            admitted += plausible.admits(0, position - late, reported * period_s)
            assert not plausible.jumped[0]
    assert admitted > 0.94 * 4000
