"""Description of a simulated arm: the nominal arm, and the deviations of the true one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from common.errors import ConfigurationError
from simulator.friction_law import FrictionLaw, Kind
from simulator.gear_settings import GearSettings
from simulator.profile import MotorMake, SimulatedMake, profile_of

Percent = Annotated[float, Meta(ge=0.0, le=50.0)]
Milliseconds = Annotated[float, Meta(ge=0.0, le=50.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]


@dataclass(frozen=True, slots=True)
class DriveDescription:
    """One drive: its EDS, and its make as mounted in the joint. For a motor with integrated
    controller there is no EDS, and `make` describes its sensors."""

    eds: Path | None
    make: SimulatedMake
    motor: MotorMake | None = None


class EncoderError(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Periodic error of an encoder: its reading is too high by
    amplitude * sin(order * angle + phase), with the angle of the joint or of the motor shaft.
    Velocities are measured without it."""

    encoder: Literal["link", "motor"]
    order: Annotated[int, Meta(ge=1, le=64)] = 1  # periods per turn
    amplitude: Annotated[float, Meta(ge=0.0, le=0.1)]  # at the link [rad], of either encoder
    phase: Annotated[float, Meta(ge=-7.0, le=7.0)] = 0.0  # [rad]


@dataclass(frozen=True, slots=True)
class JointDescription:
    """One joint, its motor and drive, in SI units at the link side: friction [Nm], [Nm s/rad]."""

    name: str
    node: int
    gear: float
    rated_current_A: float
    max_current_A: float
    torque_constant: float
    """K_c, at the link [Nm/A]."""
    rotor_inertia: float
    """B, reflected to the link [kg m^2]."""
    half_gap: float
    """alpha [rad]; 0 means no gap."""
    motor_coulomb: float
    motor_viscous: float
    link_coulomb: float
    link_viscous: float
    lower: float
    upper: float
    """End stops [rad]."""
    initial_position: float = 0.0
    brake: bool = False
    """True if a brake holds the motor whenever the drive is not energised."""
    gear_stiffness: float | None = None
    """Gear stiffness beyond the gap [Nm/rad]; None: `contact_stiffness` of the settings."""
    encoder_errors: tuple[EncoderError, ...] = ()
    drive: DriveDescription | None = None
    """None: the make that `ArmDescription.eds` identifies by its product code."""

    def __post_init__(self) -> None:
        for field in ("gear", "rated_current_A", "max_current_A", "torque_constant"):
            _check(self, field, getattr(self, field) > 0.0, "more than 0")
        _check(self, "node", 1 <= self.node <= 127, "1 to 127")
        _check(self, "rotor_inertia", self.rotor_inertia >= 1e-5, "at least 1e-5 kg m^2")
        for field in (
            *("half_gap", "motor_coulomb", "motor_viscous"),
            *("link_coulomb", "link_viscous"),
        ):
            _check(self, field, getattr(self, field) >= 0.0, "at least 0")
        inside = self.lower <= self.initial_position <= self.upper
        _check(self, "initial_position", inside, f"{self.lower} to {self.upper}")


def _check(joint: JointDescription, field: str, fits: bool, allowed: str) -> None:
    if not fits:
        value = getattr(joint, field)
        raise ConfigurationError(f"simulated joint {joint.name}: {field} = {value}, not {allowed}")


@dataclass(frozen=True, slots=True)
class ArmDescription:
    """Nominal arm: `urdf` and `eds` are files; joints are in the order of the URDF."""

    urdf: Path
    eds: Path
    joints: tuple[JointDescription, ...]
    period_s: float = 0.010
    serial_number: int = 1
    """Serial number (0x1018:4) of the first drive, incremented for the others."""

    def drives(self) -> tuple[DriveDescription, ...]:
        """Drive of each joint. Raises ConfigurationError for an unknown make."""
        known: list[DriveDescription] = []
        for joint in self.joints:
            if joint.drive is None and not known:
                known.append(DriveDescription(self.eds, profile_of(self.eds)))
        return tuple(joint.drive or known[0] for joint in self.joints)


class Mismatch(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Deviations of the true arm from the nominal one [percent]; see `simulator.mismatch`."""

    mass: Percent = 3.0
    center_of_mass: Percent = 3.0
    friction: Percent = 10.0
    torque_constant: Percent = 2.0
    half_gap: Percent = 5.0
    rotor_inertia: Percent = 5.0


class SimulationSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the simulation that have no counterpart on a real robot."""

    seed: Annotated[int, Meta(ge=0)] = 1
    mismatch: Mismatch = Mismatch()
    step_s: Annotated[float, Meta(ge=1e-5, le=0.00025)] = 0.00025
    """Integration step [s]; must divide 1 ms."""
    friction: Kind = "smooth"
    friction_width: Annotated[float, Meta(ge=0.002, le=0.2)] = 0.02
    """smooth: Coulomb * tanh(velocity / width) [rad/s]."""
    presliding: Annotated[float, Meta(ge=1e-4, le=0.02)] = 0.0003
    """dahl: deflection at which friction is fully built up [rad]."""
    stribeck: Annotated[float, Meta(ge=1.0, le=2.0)] = 1.0
    """Friction near rest, relative to Coulomb friction."""
    stribeck_velocity: Annotated[float, Meta(ge=0.005, le=0.5)] = 0.05
    """Velocity at which the Stribeck rise has decayed to 1 / e [rad/s]."""
    gears: GearSettings = GearSettings()
    contact_stiffness: Annotated[float, Meta(gt=0.0, le=1e5)] = 1000.0
    """Stiffness of gap borders and end stops [Nm/rad]; reduced for light joints (`mismatch`)."""
    contact_damping_ratio: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.3
    current_filter_ms: Milliseconds = 3.0
    link_latency_ms: Milliseconds = 0.0
    velocity_noise: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.001
    """Standard deviation of the reported motor velocity at the link side [rad/s]."""
    current_noise_permille: Annotated[float, Meta(ge=0.0, le=100.0)] = 2.0
    velocity_scale_error: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.0
    velocity_bias: Annotated[float, Meta(ge=-0.1, le=0.1)] = 0.0
    """Bias of the reported motor velocity at the link side [rad/s]."""

    @property
    def law(self) -> FrictionLaw:
        """Friction law of all joints."""
        return FrictionLaw(
            self.friction, self.friction_width, self.presliding, self.stribeck,
            self.stribeck_velocity,
        )  # fmt: skip
