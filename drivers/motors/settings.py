"""Settings common to the profiles of motors of any make, and data of a model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from drivers.settings import Settings


@dataclass(frozen=True, slots=True)
class ModelFigures:
    """Data of one model, as published by the manufacturer."""

    gear: float  # turns of the rotor per turn of the output
    torque_constant: float  # at the output [Nm/A]
    rated_Nm: float  # at the output
    max_current_A: float  # 0.8 of its peak current
    speed: float  # highest speed of the output [rad/s]
    rotor: float  # inertia at the shaft [kg m2]
    velocity_max: float  # factory full scale of its feedback [rad/s]
    torque_max_Nm: float  # likewise
    stiffest: float = 500.0  # full scale of a setpoint [Nm/rad]
    most_damping: float = 5.0  # likewise [Nm s/rad]


class MotorProfile(Settings, frozen=True, kw_only=True):
    """Profile of a motor with impedance control that goes limp when it receives no frames.

    Reported torque is converted to current by the torque constant; velocity and position of the
    motor are given behind its gear.
    """

    model: str
    master_timeout_ms: int
    velocity_max: Annotated[float, Meta(gt=0, le=1000)]  # [rad/s at the output]
    torque_max_Nm: Annotated[float, Meta(gt=0, le=1000)]  # at the output
    # Longest time to an answer of the motor at boot-up.
    answer_timeout_ms: Annotated[int, Meta(ge=5, le=5000)] = 50
    # Torque at the output per A [Nm/A]; left out: as published for its model.
    torque_constant: Annotated[float, Meta(gt=0, le=100)] | None = None
    one_sign: ClassVar[bool] = True
    models: ClassVar[Mapping[Any, ModelFigures]]
    """Published data by model."""
    heard: ClassVar[str]
    """Type of frame without which the motor goes limp, for messages."""

    @property
    def figures(self) -> ModelFigures:
        """Published data of its model."""
        return self.models[self.model]

    @property
    def master_timeout_s(self) -> float:
        """Time without such a frame after which the motor goes limp [s]."""
        return self.master_timeout_ms / 1000.0

    @property
    def timeout_reaction(self) -> str:
        """Reaction of the motor when it no longer receives our frames, as text."""
        return (
            f"without a {self.heard} for {self.master_timeout_ms} ms it goes limp, and its joint "
            "falls, unless `contactd guard` holds it"
        )

    @property
    def Nm_per_A(self) -> float:
        """Torque at the output per A of motor current."""
        return self.torque_constant or self.figures.torque_constant

    @property
    def answer_timeout_s(self) -> float:
        """Answer timeout at boot-up [s]."""
        return self.answer_timeout_ms / 1000.0

    @property
    def silence_s(self) -> float:
        """0: its silence shows only as missing samples."""
        return 0.0

    @property
    def stops_alone(self) -> bool:
        """False: it goes limp."""
        return False

    @property
    def files(self) -> tuple[str, ...]:
        """Files of the profile: none, as the motor describes itself."""
        return ()

    @property
    def sends_motor_position(self) -> bool:
        """True: every feedback contains the motor position."""
        return True
