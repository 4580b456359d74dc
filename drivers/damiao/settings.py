"""Settings of Damiao motors, with bounds that are checked on reading, and data of their models."""

from typing import Annotated, Final, Literal

from msgspec import Meta

from drivers.damiao.frames import MOST_DAMPING, STIFFEST
from drivers.drive import Drive
from drivers.motors.settings import ModelFigures, MotorProfile

Model = Literal["DM4310", "DM4340", "DM6006", "DM8009"]


MODELS: Final[dict[Model, ModelFigures]] = {
    "DM4310": ModelFigures(10.0, 0.945, 3.0, 8.2, 30.0, 1.8e-5, 30.0, 10.0),
    "DM4340": ModelFigures(40.0, 4.074, 9.0, 8.2, 8.0, 2.0e-5, 10.0, 28.0),
    "DM6006": ModelFigures(6.0, 0.7308, 4.0, 16.4, 45.0, 5.8e-5, 45.0, 20.0),
    "DM8009": ModelFigures(9.0, 1.26, 20.0, 32.8, 45.0, 1.95e-4, 45.0, 54.0),
}
#: Factory full scale of the feedback's 16 bits of position, in every model [rad at the output].
REACH: Final = 12.5


class DamiaoProfile(MotorProfile, frozen=True, kw_only=True, tag_field="make", tag="damiao"):
    """Profile of a Damiao motor, whose link turns with its output: the encoder there is the link's.

    Reported torque is converted to current by the torque constant; velocity and position of the
    motor are given behind its gear.
    """

    models = MODELS
    heard = "setpoint"

    model: Model
    # Full scale, to either side, of 16 bits of position, 12 of velocity and 12 of torque: must
    # equal registers 21, 22 and 23, or the motor is refused at the start.
    position_max: Annotated[float, Meta(gt=0, le=1000)]  # [rad at the output]
    # Of the motor's own loop, at its output, about a position that follows the target velocity.
    stiffness: Annotated[float, Meta(gt=0, le=STIFFEST)]  # [Nm/rad]
    damping: Annotated[float, Meta(gt=0, le=MOST_DAMPING)]  # [Nm s/rad]
    # Time without a setpoint of ours until the motor goes limp (register 9).
    master_timeout_ms: Annotated[int, Meta(ge=1, le=60_000)] = 100


DamiaoDrive = Drive[DamiaoProfile]
