"""Models of RobStride motors as their maker builds them, and how one sits in its joint."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, sqrt
from types import MappingProxyType

from simulator.profile import TURN, SimulatedMake

ENCODER_COUNTS = 16384
"""Counts per turn of the rotor's encoder (14 bit). The one beside it is read at power-up alone."""
FILTER_MS = 1000.0 / (2.0 * pi * 40.0)
"""Low-pass of the velocity and the torque in a feedback: an assumption, 40 Hz."""
REACH = 4.0 * pi
"""Position to either side that a feedback's 16 bits reach, in every model [rad]."""


@dataclass(frozen=True, slots=True)
class Model:
    """One model; at the output where nothing else is said."""

    gear: float
    v_max: float  # ranges of frames: [rad/s]
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
"""Parameters that an owner may have saved, and ranges that another firmware has, by name."""


@dataclass(frozen=True, slots=True)
class RobStrideMake:
    """A motor as it sits in its joint. `offset` is the joint's position where its encoder stands
    at 0 [rad], `parameters` what its owner saved, `uid` its controller's."""

    model: str
    motor_sign: int = 1
    offset: float = 0.0
    parameters: Mapping[int, float] = field(default_factory=dict)
    uid: int = 0x3434_5101_005C_0016

    def sensors(self) -> SimulatedMake:
        """Its encoder and measurements, for `Sensors`; the motor's own zero is not in them."""
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
