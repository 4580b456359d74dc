"""Settings of the drives, with bounds where they are read."""

from typing import Annotated, Literal

from msgspec import Meta, field

from drivers.settings import Name, NodeId, Settings, Sign

Index = Annotated[int, Meta(ge=0x1000, le=0xFFFF)]
SubIndex = Annotated[int, Meta(ge=0, le=255)]
IntegerType = Literal["INTEGER8", "INTEGER16", "INTEGER32", "UNSIGNED8", "UNSIGNED16", "UNSIGNED32"]
Milliseconds = Annotated[int, Meta(ge=1, le=60_000)]


class Quantity(Settings, frozen=True):
    """One measured or commanded quantity: its object in the drive and its scale.

    value = sign * (offset + scale * counts), in the unit that the field of `DriveProfile` names.
    """

    object: Index
    type: IntegerType
    scale: Annotated[float, Meta(gt=0)]
    subindex: SubIndex = 0
    sign: Sign = 1
    offset: float = 0.0


class ObjectValue(Settings, frozen=True):
    """An object that is written at boot-up and read back."""

    object: Index
    value: int
    subindex: SubIndex = 0


PdoEntry = Literal[
    "statusword",
    "current",
    "torque",
    "motor_velocity",
    "motor_position",
    "link_position",
    "controlword",
    "target_velocity",
]
PdoNumber = Literal["1", "2", "3", "4"]
PdoLayout = dict[PdoNumber, Annotated[list[PdoEntry], Meta(min_length=1, max_length=8)]]


class DriveProfile(Settings, frozen=True):
    """Kind of drive: its EDS, the place of each quantity, and the layout of its PDOs.

    The motor's effort comes as current or as torque, whichever the drive reports better: as both
    are fractions of the rated value, they count the same.
    """

    eds: Name
    link_position: Quantity  # rad at the link
    motor_velocity: Quantity  # rad/s of the motor shaft
    target_velocity: Quantity  # rad/s of the motor shaft
    quick_stop_deceleration: Quantity  # rad/s2 of the motor shaft
    tpdo: PdoLayout
    rpdo: PdoLayout
    current: Quantity | None = None  # fraction of the rated current (0x6075)
    torque: Quantity | None = None  # fraction of the rated torque (0x6076)
    motor_position: Quantity | None = None  # rad of the motor shaft
    max_motor_speed: Quantity | None = None  # rad/s of the motor shaft: the drive's own limit
    heartbeat_ms: Milliseconds = 50  # of the drive; three that are missing are a fault
    master_timeout_ms: Milliseconds = 100  # without our heartbeat, and the drive quick-stops
    # How long the drive may take to answer at boot-up; 0.3 of it when it is set up again.
    sdo_timeout_ms: Annotated[int, Meta(ge=20, le=5000)] = 500
    fault_reaction: Annotated[int, Meta(ge=-32768, le=2)] = 2  # 0x605E; 2 is a quick stop
    # More objects to set at boot-up, none that contactd sets itself.
    write: list[ObjectValue] = field(default_factory=list)
    any_product: bool = False  # true: the drive's vendor and product need not be those of the EDS

    def __post_init__(self) -> None:
        if (self.current is None) is (self.torque is None):
            raise ValueError("a drive profile needs either `current` or `torque`")

    @property
    def effort(self) -> Literal["current", "torque"]:
        """The one of the two that the drive reports."""
        return "torque" if self.current is None else "current"


class Harmonic(Settings, frozen=True):
    """Part of an encoder's error that repeats with its turn: it reads too far by
    cosine cos(order a) + sine sin(order a), a being the link position without `link_offset`."""

    order: Annotated[int, Meta(ge=1, le=16)]  # times per turn
    cosine: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0  # [rad]
    sine: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0  # [rad]


class JointWiring(Settings, frozen=True):
    """Wiring of one joint: its drive on the bus, gear, currents and signs."""

    node: NodeId
    profile: Name
    gear: Annotated[float, Meta(gt=0, le=10_000)]  # turns of the motor per turn of the joint
    # Of the motor; must be what the drive has in 0x6075.
    rated_current_A: Annotated[float, Meta(gt=0, le=1000)]
    max_current_A: Annotated[float, Meta(gt=0, le=1000)]
    motor_sign: Sign = 1  # -1 where the motor counts against the joint
    link_sign: Sign = 1  # -1 where the link encoder counts against the joint
    link_offset: float = 0.0  # of the link encoder [rad]
    # Error of the link encoder that repeats with each turn, subtracted from its samples. Found by
    # `contactd identify encoders`, and only then worth writing.
    link_correction: Annotated[list[Harmonic], Meta(max_length=4)] = field(default_factory=list)
    # Of the motor shaft; given, the drive's own figure (0x6076) must agree with it.
    rated_torque_Nm: Annotated[float, Meta(gt=0, le=10_000)] | None = None
    serial: Annotated[int, Meta(ge=0, le=0xFFFFFFFF)] | None = None
