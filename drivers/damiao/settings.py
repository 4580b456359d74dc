"""Settings of Damiao motors, with bounds where they are read, and figures of their models."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

from msgspec import Meta

from drivers.damiao.frames import MOST_DAMPING, STIFFEST
from drivers.drive import Drive
from drivers.settings import Settings

Model = Literal["DM4310", "DM4340", "DM6006", "DM8009"]


@dataclass(frozen=True, slots=True)
class ModelFigures:
    """Figures of one model, as its maker publishes them."""

    gear: float  # turns of the rotor per turn of the output (register 20)
    torque_constant: float  # at the output [Nm/A]
    rated_Nm: float  # at the output
    max_current_A: float  # its own limit, 0.8 of its largest (register 3)
    speed: float  # of the output, at most [rad/s]
    rotor: float  # inertia at the shaft [kg m2]
    velocity_max: float  # as delivered (register 22) [rad/s]
    torque_max_Nm: float  # as delivered (register 23)


MODELS: Final[dict[Model, ModelFigures]] = {
    "DM4310": ModelFigures(10.0, 0.945, 3.0, 8.2, 30.0, 1.8e-5, 30.0, 10.0),
    "DM4340": ModelFigures(40.0, 4.074, 9.0, 8.2, 8.0, 2.0e-5, 10.0, 28.0),
    "DM6006": ModelFigures(6.0, 0.7308, 4.0, 16.4, 45.0, 5.8e-5, 45.0, 20.0),
    "DM8009": ModelFigures(9.0, 1.26, 20.0, 32.8, 45.0, 1.95e-4, 45.0, 54.0),
}
#: Position that the feedback's 16 bits reach in every model, as delivered [rad at the output].
REACH: Final = 12.5


class DamiaoProfile(Settings, frozen=True, tag_field="make", tag="damiao"):
    """Kind of Damiao motor, whose link turns with its output: its encoder there is the link's.

    It reports torque, which its torque constant makes a current; velocity and position of the
    motor come through its gear.
    """

    model: Model
    # What 16 bits of position, 12 of velocity and 12 of torque reach to either side: must be what
    # the motor has in its registers 21, 22 and 23; it is refused at the start where they differ.
    position_max: Annotated[float, Meta(gt=0, le=1000)]  # [rad at the output]
    velocity_max: Annotated[float, Meta(gt=0, le=1000)]  # [rad/s at the output]
    torque_max_Nm: Annotated[float, Meta(gt=0, le=1000)]  # at the output
    # Of the motor's own loop, at its output, about a position that follows the target velocity.
    stiffness: Annotated[float, Meta(gt=0, le=STIFFEST)]  # [Nm/rad]
    damping: Annotated[float, Meta(gt=0, le=MOST_DAMPING)]  # [Nm s/rad]
    # Without a setpoint of ours for so long, and the motor goes limp (register 9).
    master_timeout_ms: Annotated[int, Meta(ge=1, le=60_000)] = 100
    # How long the motor may take to answer at boot-up.
    answer_timeout_ms: Annotated[int, Meta(ge=5, le=5000)] = 50
    # What the motor gives per A, at its output [Nm/A]; left out: as published for its model.
    torque_constant: Annotated[float, Meta(gt=0, le=100)] | None = None
    one_sign: ClassVar[bool] = True

    @property
    def figures(self) -> ModelFigures:
        """Published figures of its model."""
        return MODELS[self.model]

    @property
    def Nm_per_A(self) -> float:
        """Torque at the output per A of motor current."""
        return self.torque_constant or self.figures.torque_constant

    @property
    def patience_s(self) -> float:
        """Time without a setpoint after which the motor goes limp [s]."""
        return self.master_timeout_ms / 1000.0

    @property
    def silence_s(self) -> float:
        """Nothing comes beside its samples."""
        return 0.0

    @property
    def stops_alone(self) -> bool:
        """False: it lets go."""
        return False

    @property
    def without_us(self) -> str:
        """Reaction of the motor when nothing of ours reaches it."""
        return (
            f"without a setpoint for {self.master_timeout_ms} ms it lets go, and its joint falls, "
            "unless `contactd guard` holds it"
        )

    @property
    def files(self) -> tuple[str, ...]:
        """None: the motor describes itself."""
        return ()

    @property
    def sends_motor_position(self) -> bool:
        """True: it is in every feedback."""
        return True


DamiaoDrive = Drive[DamiaoProfile]
#: Position of the motor's encoder and of the output's may differ by the gap, a wrong gear by far
#: more [rad], whole turns apart.
FAR: Final = 0.35
#: Two turns of the output look the same to its encoder.
TURN: Final = 2.0 * math.pi
