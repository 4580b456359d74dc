"""Settings of the estimator, with their bounds."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Delay = Annotated[float, Meta(ge=0, le=10)]
Kind = Literal["classical", "backlash", "two_mass"]
Presliding = Annotated[float, Meta(gt=0, le=0.1)]
Method = Literal["backward", "midpoint", "central", "motor"]


class Variant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One residual; parts of the joint dynamics can be left out, to show their effect."""

    kind: Kind = "backlash"
    friction: bool = True
    rotor_inertia: bool = True
    label: Annotated[str, Meta(min_length=1, max_length=64)] = ""

    @property
    def engages(self) -> bool:
        """True if it models the gap: terms of the gear count only while it is engaged."""
        return self.kind == "backlash"

    @property
    def name(self) -> str:
        """The label, or the kind and what differs from it: `classical`, `backlash-rotor`."""
        if self.label:
            return self.label
        if self.kind == "classical":
            return "classical" + "+friction" * self.friction + "+rotor" * self.rotor_inertia
        return self.kind + "-friction" * (not self.friction) + "-rotor" * (not self.rotor_inertia)


class GapSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Allowed errors of motor velocity and torque. The defaults suit drives of two encoders."""

    velocity_scale_error: Annotated[float, Meta(ge=0, le=0.1)] = 0.002
    velocity_bias: Annotated[float, Meta(ge=0, le=0.1)] = 0.001  # [rad/s]
    standstill: Annotated[float, Meta(ge=0, le=0.1)] = 0.002  # motor velocity [rad/s]
    hold_ticks: Annotated[int, Meta(ge=1, le=100)] = 3
    margin: Annotated[float, Meta(ge=0.12, lt=1)] = 0.12  # of alpha
    hysteresis: Annotated[float, Meta(ge=0, le=0.01)] = 0.0001  # at the border [rad]
    friction_error: Annotated[float, Meta(ge=0, le=1)] = (
        0.27  # of the motor's side, where nothing is learned
    )
    rotor_error: Annotated[float, Meta(ge=0, le=1)] = 0.15
    current_error: Annotated[float, Meta(ge=0, le=1)] = 0.05
    half_gap_error: Annotated[float, Meta(ge=0, le=1)] = 0.07
    compliance: Annotated[float, Meta(ge=0, le=0.1)] = 0.0007  # of a gear under load [rad/Nm]


class EstimatorSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the residual that decides, of those beside it, and of the samples."""

    residual: Variant = Variant()
    beside: tuple[Variant, ...] = (Variant(kind="classical", friction=False, rotor_inertia=False),)
    gain: Annotated[float, Meta(gt=0, le=1000)] = 25.0  # K [1/s]
    link_velocity: Method = "midpoint"
    motor_position: Literal["integrated", "measured"] = "integrated"
    # [rad/s] over which Coulomb friction changes its sign
    sign_width: Annotated[float, Meta(gt=0, le=1)] = 0.02
    debounce: Annotated[int, Meta(ge=1, le=100)] = 1  # ticks
    # Of the joint's Coulomb friction: raises thresholds at rest.
    stiction_share: Annotated[float, Meta(ge=0, le=2)] = 0.9
    # Of the contact level: raises thresholds of a joint whose side of the gap is unknown.
    unknown_side_share: Annotated[float, Meta(ge=0, le=2)] = 0.25
    # Corrects friction by residuals in motion, and lowers contact levels as far as that allows;
    # until then they are raised. The price: a hand that leans for minutes is partly taken for
    # friction, and a cable interrupts at a lighter touch.
    learning: bool = True
    # [rad] of motion over which friction builds up, at least and at most; the default suits gears
    # for which it is unknown.
    presliding: tuple[Presliding, Presliding] = (0.0001, 0.002)
    current_delay_ms: Delay = 3.0  # of the drive's current filter
    link_position_delay_ms: Delay = 0.0
    motor_velocity_delay_ms: Delay = 0.0  # for example of a filter in the drive
    motor_position_delay_ms: Delay = 0.0
    # URDF link at whose origin, and along whose axes, the force on the arm is estimated; by default
    # the tool point, and the axes of the last link.
    force_at: Annotated[str, Meta(max_length=64)] = ""
    gap: GapSettings = GapSettings()
