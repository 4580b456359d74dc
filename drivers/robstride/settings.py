"""Settings of RobStride motors, with bounds checked on reading, and data of their models."""

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
    """Model data from published values: torque per A rms, and inertia seen at the output. Currents
    here are peak values, as in the motor."""
    constant = Nm_per_rms / math.sqrt(2.0)
    return ModelFigures(
        gear, constant, rated_Nm, 0.8 * peak_Nm / constant, speed, inertia / gear**2, velocity_max,
        peak_Nm, *gains,
    )  # fmt: skip


_STRONG: Final = 5000.0, 100.0  # full scale of the gains in a setpoint to the larger models
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
#: Full scale of torque [Nm] and velocity [rad/s] in a feedback; the largest of any manual.
FEEDBACK: Final[dict[Model, tuple[float, float]]] = {
    "RS00": (17.0, 50.0), "RS01": (17.0, 44.0), "RS02": (17.0, 44.0), "RS03": (60.0, 50.0),
    "RS04": (120.0, 15.0), "RS05": (17.0, 50.0), "RS06": (60.0, 50.0), "EL05": (6.0, 50.0),
}  # fmt: skip
#: Full scale of position in a feedback, to either side, in every model [rad at the output].
REACH: Final = 4.0 * math.pi


class RobStrideProfile(MotorProfile, frozen=True, kw_only=True, tag_field="make", tag="robstride"):
    """Profile of a RobStride motor. Its second encoder is read only at power-up, so no encoder
    measures the link: its gap is 0 here.

    Reported torque is converted to (peak) current by the torque constant; position and velocity are
    those of the rotor, behind its gear.
    """

    models = MODELS
    heard = "frame"

    model: Model
    # Full scale, to either side, of 16 bits of position, velocity and torque, by the firmware's
    # manual. The motor has no parameter for it; only the position is compared at the start.
    position_max: Annotated[float, Meta(gt=0, le=1000)] = REACH  # [rad at the output]
    # Of the motor's own loop, at its output, about a position that follows the target velocity; at
    # most 500 and 5, or 5000 and 100, by model.
    stiffness: Annotated[float, Meta(gt=0, le=5000)]  # [Nm/rad]
    damping: Annotated[float, Meta(gt=0, le=100)]  # [Nm s/rad]
    # Time without a frame until the motor goes limp (canTimeout).
    master_timeout_ms: Annotated[int, Meta(ge=1, le=5000)] = 100


RobStrideDrive = Drive[RobStrideProfile]


def serial_of(uid: int) -> int:
    """Serial number for `wiring.serial`: XOR of both halves of the controller's 64-bit number."""
    return uid >> 32 ^ uid & 0xFFFF_FFFF
