"""Wiring of one joint: its drive on the bus, gear, currents, signs and link encoder."""

from typing import Annotated

from msgspec import Meta, field

from drivers.settings import Name, NodeId, Settings, Sign


class Harmonic(Settings, frozen=True):
    """One harmonic of the encoder error over a turn: its reading is too high by
    cosine cos(order a) + sine sin(order a), where a is the link position without `link_offset`."""

    order: Annotated[int, Meta(ge=1, le=16)]  # times per turn
    cosine: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0  # [rad]
    sine: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0  # [rad]


class JointWiring(Settings, frozen=True):
    """Wiring of one joint: its drive on the bus, gear, currents and signs."""

    node: NodeId
    profile: Name
    gear: Annotated[float, Meta(gt=0, le=10_000)]  # turns of the motor per turn of the joint
    # Of the motor; must equal object 0x6075 of the drive.
    rated_current_A: Annotated[float, Meta(gt=0, le=1000)]
    max_current_A: Annotated[float, Meta(gt=0, le=1000)]
    motor_sign: Sign = 1  # -1 if the motor counts opposite to the joint
    link_sign: Sign = 1  # -1 if the link encoder counts opposite to the joint
    link_offset: float = 0.0  # of the link encoder [rad]
    # Periodic error of the link encoder, subtracted from its samples. Leave it out unless
    # `contactd identify encoders` has measured it.
    link_correction: Annotated[list[Harmonic], Meta(max_length=4)] = field(default_factory=list)
    # Of the motor shaft; if given, object 0x6076 of the drive must agree with it.
    rated_torque_Nm: Annotated[float, Meta(gt=0, le=10_000)] | None = None
    serial: Annotated[int, Meta(ge=0, le=0xFFFFFFFF)] | None = None
