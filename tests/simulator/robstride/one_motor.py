"""One RobStride motor on a swinging bar, and a master that packs frames by a way of its own."""

import struct
from dataclasses import replace
from typing import Any

import can

from simulator.arm import SimulatedArm
from simulator.description import ArmDescription, DriveDescription, SimulationSettings
from simulator.robstride.models import MODELS, RobStrideMake
from simulator.robstride.motor import RobStrideMotor
from tests.simulator.damiao.one_motor import JOINT, QUIET, URDF

ID, HOST = 0x05, 0xFD
P_MAX = 12.566370614359172


class One:
    """A motor, its arm and its master."""

    def __init__(self, make: RobStrideMake | None = None, **settings: Any) -> None:
        make = make or RobStrideMake("RS02")
        self.model, self.frames = MODELS[make.model], list[can.Message]()
        joint = replace(
            JOINT, node=ID, gear=self.model.gear, torque_constant=self.model.torque_constant,
            max_current_A=self.model.max_current_A, rotor_inertia=0.01,
            drive=DriveDescription(None, make.sensors(), make),
        )  # fmt: skip
        self.arm = SimulatedArm(
            ArmDescription(URDF, URDF, (joint,)),
            SimulationSettings(**(QUIET | settings)),
            self.frames.append,
        )
        self.arm.power_on()

    @property
    def motor(self) -> RobStrideMotor:
        motor = self.arm.motors[0]
        assert isinstance(motor, RobStrideMotor)
        return motor

    def send(self, can_id: int, data: bytes = bytes(8)) -> list[tuple[int, bytes]]:
        """Every answer to one frame."""
        self.frames.clear()
        self.arm.receive(can.Message(arbitration_id=can_id, data=data, is_extended_id=True))
        assert all(frame.is_extended_id for frame in self.frames)
        return [(frame.arbitration_id, bytes(frame.data)) for frame in self.frames]

    def order(self, kind: int, data: bytes = bytes(8)) -> tuple[int, bytes]:
        """The one answer to a frame of this type."""
        (answer,) = self.send(kind << 24 | HOST << 8 | ID, data)
        return answer

    def write(self, index: int, value: float, layout: str = "<f") -> tuple[int, bytes]:
        raw = struct.pack(layout, value).ljust(4, b"\0")
        return self.order(0x12, struct.pack("<HH", index, 0) + raw)

    def read(self, index: int) -> float:
        can_id, data = self.order(0x11, struct.pack("<HHI", index, 0, 0))
        assert can_id == 0x11 << 24 | ID << 8 | HOST
        assert data[:4] == struct.pack("<HH", index, 0)
        return float(struct.unpack("<f", data[4:])[0])

    def control(self, p: float, v: float, kp: float, kd: float, t: float) -> tuple[int, bytes]:
        """Feedback of an impedance; fields rounded to the nearest."""
        m = self.model
        p_u, v_u, t_u = (
            round((x / most + 1.0) * 32767.5)
            for x, most in ((p, P_MAX), (v, m.v_max), (t, m.t_max))
        )
        gains = (round(65535 * x / most) for x, most in ((kp, m.kp_max), (kd, m.kd_max)))
        data = b"".join(u.to_bytes(2, "big") for u in (p_u, v_u, *gains))
        (answer,) = self.send(0x01 << 24 | t_u << 8 | ID, data)
        return answer

    def decode(self, answer: tuple[int, bytes]) -> tuple[int, float, float, float]:
        """Mode and faults, position, velocity and torque of a feedback."""
        can_id, data = answer
        assert can_id & 0xFF == HOST
        assert can_id >> 8 & 0xFF == ID
        assert can_id >> 24 == 2
        numbers = (int.from_bytes(data[i : i + 2], "big") + 0.5 for i in (0, 2, 4))
        most = P_MAX, self.model.v_max, self.model.t_max
        p, v, t = (u / 32767.5 * high - high for u, high in zip(numbers, most, strict=True))
        return can_id >> 16 & 0xFF, p, v, t

    def run(self, seconds: float, each: Any = lambda: None) -> None:
        """Let time pass, 10 ms at a time."""
        for _ in range(round(100 * seconds)):
            self.arm.advance(self.arm.now + 0.01)
            each()
