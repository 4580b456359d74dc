"""Settings of the simulated gears; all neutral, a gear is the estimator's own model."""

from typing import Annotated

import msgspec
from msgspec import Meta

Ripple = Annotated[float, Meta(ge=0.0, le=90.0)]
Share = Annotated[float, Meta(ge=0.0, le=0.5)]


class GearSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gears of all joints, in what the estimator does not model; phases are drawn per joint."""

    load_driving: Share = 0.0
    """Coulomb friction at the motor per transmitted torque, the motor driving the link: a gear of
    efficiency eta has 1 / eta - 1."""
    load_driven: Share = 0.0
    """The same, the link driving the motor: 1 - eta."""
    friction_ripple: Ripple = 0.0
    """Amplitude of friction twice a turn of the motor, and twice a turn of the joint [percent]."""
    cogging: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0
    """Amplitude of the torque twelve times a turn of the motor [percent of the rated torque]."""
    rest_rise: Annotated[float, Meta(ge=1.0, le=3.0)] = 1.0
    """Friction after a long rest, over that in motion; 20 s of motion take 63 % of it away."""
    rest_s: Annotated[float, Meta(gt=0.0, le=36000.0)] = 120.0
    """Time constant of that rise [s]."""
    gap_ripple: Ripple = 0.0
    """Amplitude of the half-gap, once a turn of the joint [percent]."""
