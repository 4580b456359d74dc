"""False feedback: of another motor, or of a place where the motor is not."""

from collections.abc import Callable

import pytest

from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from daemon.modes.table import Mode
from drivers.can.wire import Frame, Wire
from drivers.damiao.frames import ANSWERS, Status
from programs.contactd.travels import travels
from tests.drivers.motors.one_arm import Filter, furthest

JOINT = 3  # which bears a load
STILL = 0.002  # [rad]
COUNT = 2.0 * 12.5 / 0xFFFF  # [rad]
FAR, TURN, NEAR = 9.4, 6.2832, 0.25  # as far from where the motor is [rad]

KINDS = {
    "another motor's": (0x19, FAR),
    "a far place": (0x14, FAR),
    "a far place, without power": (0x04, FAR),
    "a far place, in fault": (0xA4, FAR),
    "a turn away": (0x14, TURN),
    "a turn away, without power": (0x04, TURN),
    "near": (0x14, NEAR),
    "near, without power": (0x04, NEAR),
}


class Falsified:
    """Wire that replaces the next so many feedbacks of a motor."""

    def __init__(self, wire: Wire) -> None:
        self.wire, self.left = wire, 0
        self.head, self.counts = 0, 0
        self.send = wire.send

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, or what replaces it."""
        frame = self.wire.receive(timeout)
        if not frame or not self.left or frame[0] != JOINT + 1 + ANSWERS:
            return frame
        if frame[1][2] in (0x33, 0x55):  # about a register
            return frame
        self.left -= 1
        position = int.from_bytes(bytes(frame[1][1:3]), "big") + self.counts
        return frame[0], bytes((self.head,)) + position.to_bytes(2, "big") + bytes(frame[1][3:])


def holding(run: Callable[[Rig, Falsified], None]) -> None:
    wires: list[Falsified] = []

    def between(wire: Wire) -> Filter:
        wires.append(Falsified(wire))
        return Filter(wires[-1])

    with lockstep_rig(OPENARM, between=between) as rig:
        rig.enable()
        rig.run(1.0)
        run(rig, wires[0])


def falsify(wire: Falsified, kind: str, frames: int) -> None:
    head, way = KINDS[kind]
    wire.head, wire.counts, wire.left = head, round(way / COUNT), frames


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frames", [1, 2])
def test_up_to_two_false_feedbacks_move_nothing(kind: str, frames: int) -> None:
    def run(rig: Rig, wire: Falsified) -> None:
        falsify(wire, kind, frames)
        assert furthest(rig, 1.5).max() < STILL
        assert rig.mode is Mode.HOLDING

    holding(run)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frames", [10, 400])
def test_ten_false_feedbacks_fault_the_arm_which_goes_on_holding(kind: str, frames: int) -> None:
    def run(rig: Rig, wire: Falsified) -> None:
        falsify(wire, kind, frames)
        # The output bears out a whole turn: p follows then, as fast as the joint may move.
        most = travels(rig.robot.configuration)[JOINT].total if "turn" in kind else STILL
        assert furthest(rig, 3.0).max() < most
        assert rig.mode is Mode.FAULTED
        runs_on = "turn" in kind and frames == 400
        assert rig.arm.motors[JOINT].status == (Status.DISABLED if runs_on else Status.ENABLED)

    holding(run)
