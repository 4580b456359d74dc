"""What the configuration may say about the estimator; bounds where it is read."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from estimator.link_velocity import Method
from estimator.motor_position import GapSettings
from estimator.residual import Variant

Delay = Annotated[float, Meta(ge=0, le=10)]


class EstimatorSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The residual that decides, those that run beside it, and how samples are understood."""

    residual: Variant = Variant()
    beside: tuple[Variant, ...] = (Variant(kind="classical", friction=False, rotor_inertia=False),)
    gain: Annotated[float, Meta(gt=0, le=1000)] = 25.0  # K [1/s]
    link_velocity: Method = "midpoint"
    motor_position: Literal["integrated", "measured"] = "integrated"
    sign_width: Annotated[float, Meta(gt=0, le=1)] = 0.02  # [rad/s], goes to the Transmission
    debounce: Annotated[int, Meta(ge=1, le=100)] = 1  # ticks
    # of Coulomb friction: raises the contact thresholds at rest. With friction known to 20 %, 0.5
    # leaves a few alarms on a joint with strong stiction that stops under load, 1.0 leaves none.
    stiction_share: Annotated[float, Meta(ge=0, le=2)] = 0.5
    current_delay_ms: Delay = 3.0  # of the drive's current filter
    link_position_delay_ms: Delay = 0.0
    motor_velocity_delay_ms: Delay = 0.0
    gap: GapSettings = GapSettings()
