"""Settings of CANopen drives, with bounds that are checked on reading."""

from typing import Annotated, ClassVar, Final, Literal

from msgspec import Meta, field

from drivers.drive import Drive
from drivers.settings import Name, Settings, Sign

Index = Annotated[int, Meta(ge=0x1000, le=0xFFFF)]
SubIndex = Annotated[int, Meta(ge=0, le=255)]
IntegerType = Literal["INTEGER8", "INTEGER16", "INTEGER32", "UNSIGNED8", "UNSIGNED16", "UNSIGNED32"]
#: Consecutive heartbeats of a drive whose loss is tolerated.
HEARTBEATS_MISSED: Final = 3
Milliseconds = Annotated[int, Meta(ge=1, le=60_000)]


class Quantity(Settings, frozen=True):
    """One measured or commanded quantity: its object in the drive and its scale.

    value = sign * (offset + scale * counts), in the unit that the field of `CanopenProfile` names.
    """

    object: Index
    type: IntegerType
    scale: Annotated[float, Meta(gt=0)]
    subindex: SubIndex = 0
    sign: Sign = 1
    offset: float = 0.0


class ObjectValue(Settings, frozen=True):
    """Object that is written at boot-up and read back."""

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


class CanopenProfile(Settings, frozen=True, tag_field="make", tag="canopen"):
    """Profile of a CANopen drive: its EDS, the object of each quantity, and the layout of its PDOs.

    The motor effort is given as current or torque, whichever the drive reports better: both are
    fractions of the rated value, so they are equivalent.
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
    heartbeat_ms: Milliseconds = 50  # of the drive; three missing ones are a fault
    master_timeout_ms: Milliseconds = 100  # without our heartbeat until the drive quick-stops
    # Longest time to an SDO answer at boot-up; 0.3 of it when set up again.
    sdo_timeout_ms: Annotated[int, Meta(ge=20, le=5000)] = 500
    fault_reaction: Annotated[int, Meta(ge=-32768, le=2)] = 2  # 0x605E; 2 is a quick stop
    # Further objects to set at boot-up; none that contactd sets itself.
    write: list[ObjectValue] = field(default_factory=list)
    any_product: bool = False  # true: vendor and product of the drive may differ from the EDS
    one_sign: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if (self.current is None) is (self.torque is None):
            raise ValueError("a drive profile needs either `current` or `torque`")

    @property
    def master_timeout_s(self) -> float:
        """Time without the master's heartbeat after which the drive stops by itself [s]."""
        return self.master_timeout_ms / 1000.0

    @property
    def silence_s(self) -> float:
        """Time after which missing heartbeats are detected [s]."""
        return HEARTBEATS_MISSED * self.heartbeat_ms / 1000.0

    @property
    def stops_alone(self) -> bool:
        """True: a drive that does not stop by itself is refused."""
        return True

    @property
    def timeout_reaction(self) -> str:
        """Reaction of the drive when it no longer receives our frames, as text."""
        return f"without our heartbeat for {self.master_timeout_ms} ms it quick-stops and holds"

    @property
    def files(self) -> tuple[str, ...]:
        """EDS of the drive."""
        return (self.eds,)

    @property
    def sends_motor_position(self) -> bool:
        """True if a TPDO carries the motor position."""
        return any("motor_position" in entries for entries in self.tpdo.values())

    @property
    def effort(self) -> Literal["current", "torque"]:
        """Quantity that represents the motor effort."""
        return "torque" if self.current is None else "current"


CanopenDrive = Drive[CanopenProfile]
