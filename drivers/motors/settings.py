"""Settings that profiles of motors of any make share, and figures of a model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from drivers.settings import Settings


@dataclass(frozen=True, slots=True)
class ModelFigures:
    """Figures of one model, as its maker publishes them."""

    gear: float  # turns of the rotor per turn of the output
    torque_constant: float  # at the output [Nm/A]
    rated_Nm: float  # at the output
    max_current_A: float  # 0.8 of its largest
    speed: float  # of the output, at most [rad/s]
    rotor: float  # inertia at the shaft [kg m2]
    velocity_max: float  # that its feedback reaches, as delivered [rad/s]
    torque_max_Nm: float  # likewise
    stiffest: float = 500.0  # that a setpoint reaches [Nm/rad]
    most_damping: float = 5.0  # [Nm s/rad]


class MotorProfile(Settings, frozen=True, kw_only=True):
    """Kind of motor that follows an impedance, and lets go when nothing is sent to it.

    It reports torque, which its torque constant makes a current; velocity and position of the
    motor come through its gear.
    """

    model: str
    master_timeout_ms: int
    velocity_max: Annotated[float, Meta(gt=0, le=1000)]  # [rad/s at the output]
    torque_max_Nm: Annotated[float, Meta(gt=0, le=1000)]  # at the output
    # How long the motor may take to answer at boot-up.
    answer_timeout_ms: Annotated[int, Meta(ge=5, le=5000)] = 50
    # What the motor gives per A, at its output [Nm/A]; left out: as published for its model.
    torque_constant: Annotated[float, Meta(gt=0, le=100)] | None = None
    one_sign: ClassVar[bool] = True
    models: ClassVar[Mapping[Any, ModelFigures]]
    """Published figures by model"""
    heard: ClassVar[str]
    """Frames without which it goes limp, of which each make states the time"""

    @property
    def figures(self) -> ModelFigures:
        """Published figures of its model."""
        return self.models[self.model]

    @property
    def patience_s(self) -> float:
        """Time without one of ours after which the motor goes limp [s]."""
        return self.master_timeout_ms / 1000.0

    @property
    def without_us(self) -> str:
        """Reaction of the motor when nothing of ours reaches it."""
        return (
            f"without a {self.heard} for {self.master_timeout_ms} ms it lets go, and its joint "
            "falls, unless `contactd guard` holds it"
        )

    @property
    def Nm_per_A(self) -> float:
        """Torque at the output per A of motor current."""
        return self.torque_constant or self.figures.torque_constant

    @property
    def answer_timeout_s(self) -> float:
        """The same, as configured [s]."""
        return self.answer_timeout_ms / 1000.0

    @property
    def silence_s(self) -> float:
        """Nothing comes beside its samples."""
        return 0.0

    @property
    def stops_alone(self) -> bool:
        """False: it lets go."""
        return False

    @property
    def files(self) -> tuple[str, ...]:
        """None: the motor describes itself."""
        return ()

    @property
    def sends_motor_position(self) -> bool:
        """True: it is in every feedback."""
        return True
