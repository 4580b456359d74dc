"""One Damiao motor on a swinging bar, and a master that packs frames by a way of its own."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np

from simulator.arm import SimulatedArm
from simulator.damiao.models import MODELS, DamiaoMake
from simulator.damiao.motor import DamiaoMotor
from simulator.description import (
    ArmDescription,
    DriveDescription,
    JointDescription,
    Mismatch,
    SimulationSettings,
)

URDF = Path(__file__).parents[3] / "configs" / "single_joint" / "arm.urdf"
CAN_ID, MASTER_ID = 5, 0x15
ENABLE, DISABLE, ZERO, CLEAR = (b"\xff" * 7 + bytes([last]) for last in (0xFC, 0xFD, 0xFE, 0xFB))
NOMINAL = Mismatch(
    mass=0, center_of_mass=0, friction=0, torque_constant=0, half_gap=0, rotor_inertia=0
)
QUIET = {"velocity_noise": 0.0, "current_noise_permille": 0.0, "mismatch": NOMINAL}
JOINT = JointDescription(
    name="joint", node=CAN_ID, gear=40, rated_current_A=3, max_current_A=20, torque_constant=4.074,
    rotor_inertia=0.032, half_gap=0.0, motor_coulomb=0.0, motor_viscous=0.0, link_coulomb=0.0,
    link_viscous=0.0, lower=-6.0, upper=6.0,
)  # fmt: skip


def as_float(data: bytes) -> float:
    return float(struct.unpack("<f", data)[0])


class One:
    """A motor, its arm and its master."""

    def __init__(self, make: DamiaoMake, joint: JointDescription = JOINT, **settings: Any) -> None:
        model = MODELS[make.model]
        joint = replace(
            joint, gear=model.gear, torque_constant=model.torque_constant,
            rotor_inertia=model.rotor_inertia * model.gear**2,
            drive=DriveDescription(None, make.sensors(), make),
        )  # fmt: skip
        self.model, self.frames = model, list[can.Message]()
        self.arm = SimulatedArm(
            ArmDescription(URDF, URDF, (joint,)),
            SimulationSettings(**(QUIET | settings)),
            self.frames.append,
        )
        self.arm.power_on()

    @property
    def motor(self) -> DamiaoMotor:
        return self.arm.motors[0]

    def send(self, cob_id: int, data: bytes) -> list[tuple[int, bytes]]:
        """Every answer to one frame."""
        self.frames.clear()
        self.arm.receive(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))
        return [(frame.arbitration_id, bytes(frame.data)) for frame in self.frames]

    def ask(self, cob_id: int, data: bytes) -> bytes:
        """The one answer to a frame."""
        ((by, answer),) = self.send(cob_id, data)
        assert by == MASTER_ID
        return answer

    def read(self, register: int) -> bytes:
        head = bytes([CAN_ID, 0, 0x33, register])
        answer = self.ask(0x7FF, head + bytes(4))
        assert answer[:4] == head
        return answer[4:]

    def write(self, register: int, value: float) -> bytes:
        """Value of the register then, as the motor reports it."""
        raw = struct.pack("<I" if isinstance(value, int) else "<f", value)
        answer = self.ask(0x7FF, bytes([CAN_ID, 0, 0x55, register]) + raw)
        assert answer[:4] == bytes([CAN_ID, 0, 0x55, register])
        return answer[4:]

    def enable(self, mode: int) -> bytes:
        self.write(10, mode)
        return self.ask(CAN_ID + 0x100 * (mode - 1), ENABLE)

    def mit(self, p: float, v: float, kp: float, kd: float, t: float) -> bytes:
        """Feedback of an impedance; fields rounded to the nearest."""
        ranges = [(p, -self.p_max, self.p_max, 16), (v, -self.v_max, self.v_max, 12)]
        ranges += [(kp, 0, 500, 12), (kd, 0, 5, 12), (t, -self.t_max, self.t_max, 12)]
        bits = ""
        for x, low, high, count in ranges:
            bits += format(round((x - low) / (high - low) * (2**count - 1)), f"0{count}b")
        return self.ask(CAN_ID, int(bits, 2).to_bytes(8, "big"))

    def velocity(self, v: float) -> bytes:
        return self.ask(0x200 + CAN_ID, struct.pack("<f", v))

    p_max = property(lambda self: self.model.p_max)
    v_max = property(lambda self: self.model.v_max)
    t_max = property(lambda self: self.model.t_max)

    def decode(self, feedback: bytes) -> tuple[int, float, float, float]:
        """Status, position, velocity and torque, in the middle of what their fields stand for."""
        number = int.from_bytes(feedback[1:6], "big")
        fields = (number >> 24, number >> 12 & 0xFFF, number & 0xFFF)
        most = (self.p_max, self.v_max, self.t_max)
        p, v, t = (
            (u + 0.5) * 2 * high / (2**bits - 1) - high
            for u, high, bits in zip(fields, most, (16, 12, 12), strict=True)
        )
        return feedback[0] >> 4, p, v, t

    def run(self, seconds: float, each: Any = lambda: None) -> list[Any]:
        """Let time pass, 10 ms at a time; what `each` gave after every one."""
        values = []
        for _ in range(round(seconds / 0.01)):
            self.arm.advance(self.arm.now + 0.01)
            values.append(each())
        return values

    @property
    def gravity(self) -> float:
        return float(self.arm.plant.weight(self.arm.plant.q)[0])

    @property
    def theta(self) -> float:
        return float(np.asarray(self.arm.plant.theta)[0])
