"""The nominal Romeo arm, a plain master of its drives, and a single joint."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pinocchio as pin
import pytest

from simulator.arm import SimulatedArm
from simulator.description import ArmDescription, JointDescription, Mismatch, SimulationSettings
from simulator.events import SimulationEvent
from simulator.mismatch import PlantParameters

FOLDER = Path(__file__).parents[2] / "configs" / "romeo_left_arm"
COLUMNS: dict[str, list[Any]] = {
    "name": [
        "LShoulderPitch", "LShoulderYaw", "LElbowRoll", "LElbowYaw", "LWristRoll", "LWristYaw",
        "LWristPitch",
    ],
    "node": [1, 2, 3, 4, 5, 6, 7],
    "gear": [150.0, 150.0, 100.0, 100.0, 100.0, 80.0, 80.0],
    "rated_current_A": [2.0, 1.5, 1.2, 1.2, 0.6, 0.3, 0.3],
    "max_current_A": [4.0, 3.0, 2.4, 2.4, 1.2, 0.6, 0.6],
    "torque_constant": [4.77, 3.01, 3.09, 2.51, 1.81, 1.44, 1.0],
    "rotor_inertia": [0.08, 0.06, 0.03, 0.025, 0.008, 0.003, 0.003],
    "half_gap": [0.018, 0.025, 0.003, 0.011, 0.0, 0.0, 0.023],
    "motor_coulomb": [0.9, 0.7, 0.4, 0.35, 0.12, 0.05, 0.04],
    "motor_viscous": [0.6, 0.4, 0.2, 0.15, 0.05, 0.02, 0.02],
    "link_coulomb": [0.09, 0.07, 0.04, 0.035, 0.012, 0.005, 0.004],
    "link_viscous": [0.06, 0.04, 0.02, 0.015, 0.005, 0.002, 0.002],
    "lower": [-1.44478, -0.430472, -2.0944, -1.5708, -3.66519, -0.436332, -0.977384],
    "upper": [2.22041, 1.14032, 2.0944, 0.0, 0.523599, 0.436332, 0.977384],
    "initial_position": [0.0, 0.2, 0.0, -0.5, 0.0, 0.0, 0.0],
}  # fmt: skip
SHUTDOWN, SWITCH_ON, ENABLE = 0x06, 0x07, 0x0F
NOMINAL = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)


@pytest.fixture(scope="session")
def romeo() -> ArmDescription:
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in zip(*COLUMNS.values(), strict=True)]
    joints = tuple(JointDescription(**row) for row in rows)
    return ArmDescription(urdf=FOLDER / "arm.urdf", eds=FOLDER / "drive.eds", joints=joints)


class Master:
    """Frames to and from a simulated arm, without a bus; heartbeats as node 127."""

    def __init__(self, description: ArmDescription, **settings: Any) -> None:
        self.frames: list[can.Message] = []
        self.events: list[SimulationEvent] = []
        script = settings.pop("hand_script", ())
        self.arm = SimulatedArm(
            description,
            SimulationSettings(**settings),
            self.frames.append,
            hand_script=script,
            on_event=self.events.append,
        )
        self.description = description
        self.arm.power_on()

    def send(self, cob_id: int, data: bytes = b"") -> list[tuple[int, bytes]]:
        """Send one frame; what the arm answered."""
        before = len(self.frames)
        self.arm.receive(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
        return [(f.arbitration_id, bytes(f.data)) for f in self.frames[before:]]

    def write(self, node: int, index: int, sub: int, code: str, value: int) -> int:
        """Expedited SDO download: 0, or the abort code."""
        raw = struct.pack("<" + code, value)
        head = struct.pack("<BHB", 0x23 | (4 - len(raw)) << 2, index, sub)
        ((cob, answer),) = self.send(0x600 + node, head + raw.ljust(4, b"\0"))
        assert cob == 0x580 + node
        return 0 if answer[0] == 0x60 else int(struct.unpack_from("<I", answer, 4)[0])

    def read(self, node: int, index: int, sub: int, code: str) -> int:
        """Expedited SDO upload."""
        ((_, answer),) = self.send(0x600 + node, struct.pack("<BHBI", 0x40, index, sub, 0))
        assert answer[0] & 0xE3 == 0x43, answer.hex()
        return int(struct.unpack_from("<" + code, answer, 4)[0])

    def map_pdo(self, node: int, communication: int, cob: int, entries: list[int]) -> None:
        """Map one PDO by the procedure of CiA 301, on every SYNC."""
        mapped = communication + 0x200
        assert not self.write(node, communication, 1, "I", 1 << 31 | cob)
        assert not self.write(node, mapped, 0, "B", 0)
        for sub, entry in enumerate(entries, start=1):
            assert not self.write(node, mapped, sub, "I", entry)
        assert not self.write(node, mapped, 0, "B", len(entries))
        assert not self.write(node, communication, 2, "B", 1)
        assert not self.write(node, communication, 1, "I", cob)

    def set_up(self, *, loss: int = 3, quick_stop: int = 6, fault: int = 2) -> None:
        """Everything a master writes before OPERATIONAL: csv at 10 ms, heartbeats 100 ms."""
        for drive in self.arm.drives:
            node = drive.node
            for number in range(4):
                self.write(node, 0x1400 + number, 1, "I", 1 << 31 | 0x200 + 0x100 * number + node)
                self.write(node, 0x1800 + number, 1, "I", 3 << 30 | 0x180 + 0x100 * number + node)
            self.map_pdo(node, 0x1400, 0x200 + node, [0x60400010, 0x60FF0020])
            self.map_pdo(node, 0x1800, 0x180 + node, [0x60410010, 0x60780010, 0x606C0020])
            self.map_pdo(node, 0x1801, 0x280 + node, [0x60E40120, 0x60640020])
            for index, sub, code, value in (
                (0x6007, 0, "h", loss),
                (0x605A, 0, "h", quick_stop),
                (0x605E, 0, "h", fault),
                (0x6060, 0, "b", 9),
                (0x60C2, 1, "B", 10),
                (0x1016, 1, "I", 127 << 16 | 100),
                (0x6085, 0, "I", round(10.0 / drive.axis.unit)),
            ):
                assert not self.write(node, index, sub, code, value)
        self.send(0, b"\x01\x00")

    def command(self, controlword: int, velocity: Any = 0.0) -> None:
        """RPDO1 to every drive; velocity at the link [rad/s], one or (n,)."""
        speeds = np.broadcast_to(velocity, len(self.arm.drives))
        for drive, speed in zip(self.arm.drives, speeds, strict=True):
            counts = round(float(speed) / drive.axis.unit)
            self.send(0x200 + drive.node, struct.pack("<Hi", controlword, counts))

    def tick(self, controlword: int | None = None, velocity: Any = 0.0) -> dict[int, bytes]:
        """One period: SYNC, answers by COB-ID, then RPDOs and heartbeat unless there is no word."""
        self.wait(self.description.period_s)
        answers = dict(self.send(0x80))
        if controlword is not None:
            self.command(controlword, velocity)
            self.send(0x77F, b"\x05")
        return answers

    def wait(self, seconds: float) -> None:
        """Let time pass without a frame from this master."""
        self.arm.advance(self.arm.now + seconds)

    def enable(self) -> None:
        """Set up and step through to operation enabled."""
        self.set_up()
        for word in (SHUTDOWN, SWITCH_ON, ENABLE, ENABLE):
            self.tick(word)


@pytest.fixture
def master(romeo: ArmDescription) -> Callable[..., Master]:
    """Makes a master of an arm that is exactly the nominal one; keywords are settings."""

    def make(description: ArmDescription = romeo, **settings: Any) -> Master:
        return Master(description, **{"mismatch": NOMINAL, **settings})

    return make


@pytest.fixture
def one(master: Callable[..., Master]) -> Master:
    """A master of the nominal arm, not set up."""
    return master()


@pytest.fixture
def pendulum() -> Callable[..., PlantParameters]:
    """One joint about a horizontal axis, 0.5 kg at 0.2 m, all else to taste."""

    def make(**changes: Any) -> PlantParameters:
        model = pin.Model()
        model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pendulum")
        inertia = pin.Inertia(0.5, np.array([0.0, 0.0, -0.2]), 0.001 * np.eye(3))
        model.appendBodyToJoint(1, inertia, pin.SE3.Identity())
        link = np.array([0.021])
        plain = PlantParameters(
            model=model,
            half_gap=np.array([0.02]),
            rotor_inertia=np.array([0.05]),
            torque_constant=np.array([1.0]),
            coulomb=np.zeros(2),
            viscous=np.zeros(2),
            stiffness=np.array([1000.0]),
            damping=np.zeros(1),
            lower=np.array([-3.0]),
            upper=np.array([3.0]),
            initial_position=np.zeros(1),
            lightest_link=link,
            usual_link=link,
        )
        return replace(plain, **changes)

    return make
