"""Models of Damiao motors as manufactured, and their mounting in a joint."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from types import MappingProxyType

from simulator.profile import TURN, SimulatedMake

ENCODER_COUNTS = 16384
"""Counts per turn of both the rotor and the output encoder (14 bit)."""
FILTER_MS = 1000.0 / (2.0 * pi * 40.0)
"""Time constant of the low-pass filter of velocity and torque in a feedback: 40 Hz (V_BW)."""
_BANDWIDTH = 200.0  # of the velocity loop with the rotor alone, determines KP_ASR [1/s]


@dataclass(frozen=True, slots=True)
class Model:
    """One model; values are at the output unless stated otherwise."""

    gear: float
    p_max: float  # full scales of frames: [rad]
    v_max: float  # [rad/s]
    t_max: float  # [Nm]
    torque_constant: float  # [Nm/A]
    max_current_A: float  # reference of currents in registers
    rotor_inertia: float  # of the rotor [kg m^2]
    pole_pairs: int
    resistance: float  # of a phase [ohm]
    inductance: float  # of a phase [H]
    flux: float  # [Wb]

    @property
    def speed_kp(self) -> float:
        """KP_ASR: share of the maximum current per rad/s of the rotor."""
        at_rotor = self.torque_constant * self.max_current_A / self.gear
        return _BANDWIDTH * self.rotor_inertia / at_rotor


MODELS: Mapping[str, Model] = MappingProxyType(
    {
        "DM4310": Model(10, 12.5, 30, 10, 0.945, 10.261, 1.8e-5, 14, 0.85, 345e-6, 0.0045),
        "DM4340": Model(40, 12.5, 10, 28, 4.074, 10.261, 2.0e-5, 14, 0.88, 360e-6, 0.00485),
        "DM6006": Model(6, 12.5, 45, 20, 0.7308, 20.522, 5.8e-5, 14, 0.435, 270e-6, 0.0058),
        "DM8009": Model(9, 12.5, 45, 54, 1.2616, 41.045, 1.95e-4, 21, 0.145, 80e-6, 0.00445),
    }
)

REGISTERS = (
    "UV_Value", "KT_Value", "OT_Value", "OC_Value", "ACC", "DEC", "MAX_SPD", "MST_ID", "ESC_ID",
    "TIMEOUT", "CTRL_MODE", "Damp", "Inertia", "hw_ver", "sw_ver", "SN", "NPP", "Rs", "Ls", "Flux",
    "Gr", "PMAX", "VMAX", "TMAX", "I_BW", "KP_ASR", "KI_ASR", "KP_APR", "KI_APR", "OV_Value",
    "GREF", "Deta", "V_BW", "IQ_c1", "VL_c1", "can_br", "sub_ver",
)  # fmt: skip
"""Manufacturer's names of the registers, by number."""


@dataclass(frozen=True, slots=True)
class DamiaoMake:
    """Motor as mounted in its joint. master_id: identifier of its feedback; offset: joint position
    at which both encoders read 0 [rad]; registers: values saved by its owner."""

    model: str
    master_id: int
    motor_sign: int = 1
    link_sign: int = 1
    offset: float = 0.0
    registers: Mapping[int, float] = field(default_factory=dict)

    def sensors(self) -> SimulatedMake:
        """Encoders and measurements, for `Sensors`, without the motor's own zero."""
        return SimulatedMake(
            link_counts=self.link_sign * ENCODER_COUNTS,
            motor_counts=self.motor_sign * ENCODER_COUNTS,
            link_zero=-round(self.offset * self.link_sign * ENCODER_COUNTS / TURN),
            measured_velocity_unit=self.motor_sign * 1e-4,
            effort_unit=self.motor_sign * 0.001,
            current_filter_ms=FILTER_MS,
        )
