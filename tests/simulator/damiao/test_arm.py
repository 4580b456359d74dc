"""Arms with Damiao motors: by `simulation.yaml`, beside CANopen drives, in lockstep, and a hand."""

import shutil
import struct
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
import yaml

from bench.rigs.lines import virtual_line
from bench.rigs.lockstep import DESK_ARM
from bench.rigs.sync_clock import Lockstep
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from programs.simulate.simulated_robot import supplied_values, true_arm
from simulator.arm import SimulatedArm
from simulator.damiao.models import DamiaoMake
from simulator.hand_script import Push
from tests.simulator.damiao.one_motor import CAN_ID, ENABLE, MASTER_ID, One

NODE = 11  # of the CANopen drive


def desk_arm(tmp_path: Path, joint: dict[str, Any], others: dict[str, Any] | None = None) -> Path:
    """A copy of the desk arm whose last joint is other than there, and the other, too."""
    folder = tmp_path / "arm"
    shutil.copytree(DESK_ARM, folder)
    path = folder / "simulation.yaml"
    truth = yaml.safe_load(path.read_text())
    truth["joints"][-1] |= joint
    truth["joints"][0] |= others or {}
    path.write_text(yaml.safe_dump(truth, sort_keys=False))
    return folder


def built(folder: Path, frames: list[can.Message]) -> SimulatedArm:
    description, simulation = true_arm(load_robot(folder))
    arm = SimulatedArm(description, simulation.settings, frames.append)
    arm.power_on()
    return arm


def send(
    arm: SimulatedArm, frames: list[can.Message], cob_id: int, data: bytes
) -> dict[int, bytes]:
    frames.clear()
    arm.receive(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
    return {frame.arbitration_id: bytes(frame.data) for frame in frames}


def test_both_kinds_live_on_one_bus_and_do_not_answer_for_each_other(tmp_path: Path) -> None:
    frames: list[can.Message] = []
    motor = {"drive": "damiao:DM4340", "node": CAN_ID, "gear": 40.0, "brake": False}
    arm = built(desk_arm(tmp_path, motor), frames)
    assert [(f.arbitration_id, bytes(f.data)) for f in frames] == [(0x700 + NODE, b"\0")]
    assert [drive.node for drive in arm.drives] == [NODE]
    assert [one.can_id for one in arm.motors] == [CAN_ID]
    for cob_id, data, by in (
        (0x600 + NODE, struct.pack("<BHBI", 0x40, 0x1000, 0, 0), {0x580 + NODE}),
        (0x7FF, bytes([CAN_ID, 0, 0xCC, 0]), {CAN_ID + 0x10}),
        (0x200 + CAN_ID, bytes(4), {CAN_ID + 0x10}),
        (0x000, b"\x01\x00", set()),
        (0x080, b"", set()),
        (0x77F, b"\x05", set()),
    ):
        assert set(send(arm, frames, cob_id, data)) == by
    send(arm, frames, 0x7FF, bytes([CAN_ID, 0, 0x55, 10, 3, 0, 0, 0]))
    send(arm, frames, 0x200 + CAN_ID, ENABLE)
    for _ in range(60):
        answers = send(arm, frames, 0x200 + CAN_ID, struct.pack("<f", 0.4))
        arm.advance(arm.now + 0.01)
    assert answers[CAN_ID + 0x10][0] == 1 << 4 | CAN_ID
    assert arm.plant.theta_dot[1] == pytest.approx(0.4, abs=0.05)
    assert arm.servo.current[0] == 0.0


def test_what_the_file_says_of_a_motor(tmp_path: Path) -> None:
    joint = {
        "drive": "damiao:DM8009", "node": 3, "master_id": 0x23, "motor_sign": -1,
        "link_offset": 0.25, "registers": {"TIMEOUT": 8000, "VMAX": 40.5},
    }  # fmt: skip
    folder = desk_arm(tmp_path, joint, {"drive": "damiao:DM4310", "node": 0x0A})
    truth = yaml.safe_load((folder / "simulation.yaml").read_text())
    del truth["drives"]
    (folder / "simulation.yaml").write_text(yaml.safe_dump(truth))
    description, _ = true_arm(load_robot(folder))
    assert supplied_values(description) == []
    assert [joint.node for joint in description.joints] == [10, 3]
    assert [drive.motor for drive in description.drives()] == [
        DamiaoMake("DM4310", 0x1A),
        DamiaoMake("DM8009", 0x23, -1, 1, 0.25, {9: 8000, 22: 40.5}),
    ]


@pytest.mark.parametrize(
    ("joint", "names"),
    [
        ({"drive": "damiao:DM9999"}, ["drive", "damiao:DM4310", "damiao:DM8009", "locking_drive"]),
        ({"drive": "DM4310"}, ["drive", "damiao:DM4310"]),
        ({"drive": "damiao:DM4310", "node": NODE}, ["node", str(NODE)]),
        ({"drive": "damiao:DM4310", "registers": {"VMIN": 1.0}}, ["registers.VMIN", "VMAX"]),
    ],
)
def test_what_is_no_motor_is_refused(tmp_path: Path, joint, names) -> None:
    with pytest.raises(ConfigurationError) as refused:
        true_arm(load_robot(desk_arm(tmp_path, joint)))
    for name in names:
        assert name in str(refused.value)


def test_in_lockstep_the_frames_of_one_motor_are_the_clock() -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID))
    with virtual_line() as bus:
        one.arm._send = bus.far.send
        clock = 0x200 + CAN_ID
        lockstep = Lockstep(
            one.arm, bus.far, lambda message: 0.0 if message.arbitration_id == clock else None
        )
        for asked in range(1, 4):
            bus.near.wire.send([(0x200 + CAN_ID, bytes(4)), (0x7FF, bytes([CAN_ID, 0, 0xCC, 0]))])
            assert lockstep.pump() == 2
            assert one.arm.now == pytest.approx(0.01 * asked)
            answers = [bus.near.wire.receive(0) for _ in range(3)]
            assert [frame and frame[0] for frame in answers] == [MASTER_ID, MASTER_ID, None]


def test_the_hand_waits_for_the_first_commanded_motion() -> None:
    one = One(DamiaoMake("DM4340", MASTER_ID))
    push = Push(at_s=0.05, joint="joint", torque=1.0, duration_s=0.1)
    arm = SimulatedArm(one.arm.description, one.arm.settings, lambda _: None, hand_script=[push])
    arm.power_on()

    def send(cob_id: int, data: bytes) -> None:
        arm.receive(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
        arm.advance(arm.now + 0.01)

    send(0x7FF, bytes([CAN_ID, 0, 0x55, 10, 3, 0, 0, 0]))
    send(CAN_ID, ENABLE)
    for _ in range(20):
        send(0x200 + CAN_ID, bytes(4))
        assert not arm.tau_ext.any()
    pushed = []
    for _ in range(20):
        send(0x200 + CAN_ID, struct.pack("<f", 0.3))
        pushed.append(float(arm.tau_ext[0]))
    assert np.max(pushed) == pytest.approx(1.0)
