"""Models of RobStride motors as manufactured, and their mounting in a joint."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, sqrt
from types import MappingProxyType

from simulator.profile import TURN, SimulatedMake

ENCODER_COUNTS = 16384
"""Counts per turn of the rotor encoder (14 bit). The second encoder is read only at power-up."""
FILTER_MS = 1000.0 / (2.0 * pi * 40.0)
"""Time constant of the low-pass filter of velocity and torque in a feedback: 40 Hz, assumed."""
REACH = 4.0 * pi
"""Full scale of position in a feedback, to either side, in every model [rad]."""


@dataclass(frozen=True, slots=True)
class Model:
    """One model; values are at the output unless stated otherwise."""

    gear: float
    v_max: float  # full scales of frames: [rad/s]
    t_max: float  # [Nm]
    kp_max: float
    kd_max: float
    torque_per_rms: float  # [Nm per A rms]
    max_current_A: float  # peak

    @property
    def torque_constant(self) -> float:
        """Torque per A of peak current [Nm/A]."""
        return self.torque_per_rms / sqrt(2.0)


MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "RS00": Model(10, 33, 14, 500, 5, 1.48, 15.5),
        "RS01": Model(7.75, 44, 17, 500, 5, 1.22, 23),
        "RS02": Model(7.75, 44, 17, 500, 5, 1.22, 23),
        "RS03": Model(9, 20, 60, 5000, 100, 2.36, 43),
        "RS04": Model(9, 15, 120, 5000, 100, 2.1, 90),
        "RS05": Model(7.75, 50, 5.5, 500, 5, 0.94, 11),
        "RS06": Model(9, 50, 36, 5000, 100, 1.09, 57),
        "EL05": Model(9, 50, 6, 500, 5, 0.94, 11),
    }
)

PARAMETERS = {
    "run_mode": 0x7005, "limit_torque": 0x700B, "canTimeout": 0x7028, "zero_sta": 0x7029,
    "P_MAX": -1, "V_MAX": -2, "T_MAX": -3,
}  # fmt: skip
"""Parameters that an owner may have saved, and full scales of other firmware, by name."""


@dataclass(frozen=True, slots=True)
class RobStrideMake:
    """Motor as mounted in its joint. offset: joint position at which its encoder reads 0 [rad];
    parameters: values saved by its owner; uid: unique number of its controller."""

    model: str
    motor_sign: int = 1
    offset: float = 0.0
    parameters: Mapping[int, float] = field(default_factory=dict)
    uid: int = 0x3434_5101_005C_0016

    def sensors(self) -> SimulatedMake:
        """Encoder and measurements, for `Sensors`, without the motor's own zero."""
        gear = MODELS[self.model].gear
        return SimulatedMake(
            link_at_motor=True,
            link_counts=self.motor_sign * round(ENCODER_COUNTS * gear),
            motor_counts=self.motor_sign * ENCODER_COUNTS,
            link_zero=-round(self.offset * self.motor_sign * ENCODER_COUNTS * gear / TURN),
            measured_velocity_unit=self.motor_sign * 1e-4,
            effort_unit=self.motor_sign * 0.001,
            current_filter_ms=FILTER_MS,
        )
