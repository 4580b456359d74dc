"""Settings of the estimator, with their bounds."""

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
    stiction_share: Annotated[float, Meta(ge=0, le=2)] = 0.4  # raises thresholds at rest
    # Of the contact level: raises thresholds of a joint whose side of the gap is unknown.
    unknown_side_share: Annotated[float, Meta(ge=0, le=2)] = 0.25
    presliding: Annotated[float, Meta(gt=0, le=0.1)] = 0.0015  # [rad] until friction is built up
    current_delay_ms: Delay = 3.0  # of the drive's current filter
    link_position_delay_ms: Delay = 0.0
    motor_velocity_delay_ms: Delay = 0.0  # of a filter in the drive, for one
    motor_position_delay_ms: Delay = 0.0
    gap: GapSettings = GapSettings()
