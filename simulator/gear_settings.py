"""Settings of the simulated gears; if all are neutral, a gear equals the estimator's model."""

from typing import Annotated

import msgspec
from msgspec import Meta

Ripple = Annotated[float, Meta(ge=0.0, le=90.0)]
Share = Annotated[float, Meta(ge=0.0, le=0.5)]


class GearSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Properties of all gears that the estimator does not model; phases are drawn per joint."""

    load_driving: Share = 0.0
    """Coulomb friction at the motor per transmitted torque while the motor drives the link: 1 / eta
    - 1 for efficiency eta."""
    load_driven: Share = 0.0
    """The same while the link drives the motor: 1 - eta."""
    friction_ripple: Ripple = 0.0
    """Amplitude of friction, twice per motor turn and twice per joint turn [percent]."""
    cogging: Annotated[float, Meta(ge=0.0, le=20.0)] = 0.0
    """Amplitude of cogging torque, twelve times per motor turn [percent of the rated torque]."""
    rest_rise: Annotated[float, Meta(ge=1.0, le=3.0)] = 1.0
    """Friction after a long rest relative to motion; 20 s of motion remove 63 % of the rise."""
    rest_s: Annotated[float, Meta(gt=0.0, le=36000.0)] = 120.0
    """Time constant of that rise [s]."""
    gap_ripple: Ripple = 0.0
    """Amplitude of the half-gap, once per joint turn [percent]."""
