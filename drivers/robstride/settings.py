"""Settings of RobStride motors, with bounds where they are read, and figures of their models."""

import math
from typing import Annotated, Final, Literal

from msgspec import Meta

from drivers.drive import Drive
from drivers.motors.settings import ModelFigures, MotorProfile

Model = Literal["RS00", "RS01", "RS02", "RS03", "RS04", "RS05", "RS06", "EL05"]


def _figures(
    gear: float, Nm_per_rms: float, rated_Nm: float, peak_Nm: float, speed: float,
    inertia: float, velocity_max: float, *gains: float,
) -> ModelFigures:  # fmt: skip
    """Figures from those that the maker publishes: a torque per A rms, and an inertia that the
    output sees. Currents here are peak values, as in the motor."""
    constant = Nm_per_rms / math.sqrt(2.0)
    return ModelFigures(
        gear, constant, rated_Nm, 0.8 * peak_Nm / constant, speed, inertia / gear**2, velocity_max,
        peak_Nm, *gains,
    )  # fmt: skip


_STRONG: Final = 5000.0, 100.0  # gains that a setpoint to the larger models reaches
MODELS: Final[dict[Model, ModelFigures]] = {
    "RS00": _figures(10.0, 1.48, 5.0, 14.0, 33.0, 0.001, 33.0),
    "RS01": _figures(7.75, 1.22, 6.0, 17.0, 32.0, 0.0042, 44.0),
    "RS02": _figures(7.75, 1.22, 6.0, 17.0, 42.0, 0.0042, 44.0),
    "RS03": _figures(9.0, 2.36, 20.0, 60.0, 20.0, 0.02, 20.0, *_STRONG),
    "RS04": _figures(9.0, 2.1, 35.0, 120.0, 20.0, 0.04, 15.0, *_STRONG),
    "RS05": _figures(7.75, 0.94, 1.6, 5.5, 50.0, 0.0007, 50.0),
    "RS06": _figures(9.0, 1.09, 11.0, 36.0, 45.0, 0.012, 50.0, *_STRONG),
    "EL05": _figures(9.0, 0.94, 1.8, 6.0, 45.0, 0.00094, 50.0),  # inertia: of an RS05's rotor
}
#: Torque [Nm] and velocity [rad/s] that a feedback reaches by the manual that states most.
FEEDBACK: Final[dict[Model, tuple[float, float]]] = {
    "RS00": (17.0, 50.0), "RS01": (17.0, 44.0), "RS02": (17.0, 44.0), "RS03": (60.0, 50.0),
    "RS04": (120.0, 15.0), "RS05": (17.0, 50.0), "RS06": (60.0, 50.0), "EL05": (6.0, 50.0),
}  # fmt: skip
#: Position to either side that a feedback reaches in every model [rad at the output].
REACH: Final = 4.0 * math.pi


class RobStrideProfile(MotorProfile, frozen=True, kw_only=True, tag_field="make", tag="robstride"):
    """Kind of RobStride motor. Its second encoder is read at power-up alone, so that no encoder
    knows the link: its gap is 0 here.

    It reports torque, which its torque constant makes a current (peak); position and velocity come
    from the rotor, through its gear.
    """

    models = MODELS
    heard = "frame"

    model: Model
    # What 16 bits of position, of velocity and of torque reach to either side, by the firmware's
    # manual. The motor has no parameter that says it; only the position is compared at the start.
    position_max: Annotated[float, Meta(gt=0, le=1000)] = REACH  # [rad at the output]
    # Of the motor's own loop, at its output, about a position that follows the target velocity; by
    # model at most 500 and 5, or 5000 and 100.
    stiffness: Annotated[float, Meta(gt=0, le=5000)]  # [Nm/rad]
    damping: Annotated[float, Meta(gt=0, le=100)]  # [Nm s/rad]
    # Without a frame for so long, and the motor goes limp (canTimeout).
    master_timeout_ms: Annotated[int, Meta(ge=1, le=5000)] = 100


RobStrideDrive = Drive[RobStrideProfile]


def serial_of(uid: int) -> int:
    """Number of a motor for `wiring.serial`: both halves of its controller's 64 bits, by XOR."""
    return uid >> 32 ^ uid & 0xFFFF_FFFF
