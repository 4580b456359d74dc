"""Simulated makes of drives, each as its maker fixed it: a wrong object, scale, sign or offset in a
configuration shows here."""

from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Protocol

from common.errors import ConfigurationError
from simulator.objects import entries, key

TURN = 2.0 * pi
RPM = TURN / 60.0


@dataclass(frozen=True, slots=True)
class SimulatedMake:
    """Objects that carry a drive's quantities, and the size of one count. Motor quantities are
    before the gear; objects are keys, see `objects.key`."""

    link_position: int = key(0x60E4, 1)
    motor_position: int | None = key(0x6064)
    motor_velocity: int = key(0x606C)
    efforts: tuple[int, ...] = (key(0x6078), key(0x6077))
    """Current or torque: as shares of the rated value they are the same."""
    speed_limit: int | None = key(0x6080)

    link_counts: int = 131072
    """Counts per link revolution (17 bit); negative where the encoder counts backwards."""
    link_zero: int = 0
    """Counts where the link stands at 0."""
    link_at_motor: bool = False
    """No link encoder: `link_position` is the motor's, through the gear."""
    motor_counts: int = 4096
    """Counts per motor revolution. Negative, like the units of velocity and effort, where the motor
    sits in its joint the other way round."""
    measured_velocity_unit: float = 0.1 * RPM
    """Unit of `motor_velocity` [rad/s of the motor shaft]."""
    effort_unit: float = 0.001
    """Unit of `efforts`, share of the rated value; negative where the drive reports the opposing
    effort. Limits (6072, 6073) are per mille in every drive."""
    velocity_unit: float = 0.1 * RPM
    """60FF [rad/s of the motor shaft]."""
    acceleration_unit: float = 0.1 * RPM
    """6085 [rad/s^2 of the motor shaft]."""
    speed_unit: float = RPM
    """Unit of `speed_limit` [rad/s of the motor shaft]."""
    interpolation_s: float = 0.0
    """Time over which a setpoint is approached where there is no 60C2."""
    locks: bool = False
    """The loss of the master's heartbeat (8130) is a fault, whatever 6007 says, and no fault reset
    is taken before NMT reset communication."""
    says_over: bool = False
    """One that locks reports its error as over (EMCY 0) as soon as it hears the master again, but
    stays locked; 603F keeps the code."""
    boot_s: float = 0.0
    """From power-up or a reset to the boot-up message; it answers nothing meanwhile."""
    sdo_delay_s: float = 0.0
    """From an SDO request to its answer."""
    minds_longer: bool = False
    """An RPDO that is longer than its mapping is an error (8220), as CiA 301 allows."""
    emergency_delay_s: float = 0.0
    """From an error to its EMCY message, as by an inhibit time (1015)."""
    hears_master: bool = True
    """It watches the master's heartbeat by 1016; one that does not goes on without it."""
    current_filter_ms: float | None = None
    """Filter of the reported current, instead of that of the settings."""
    velocity_step: float = 0.0
    """The measured velocity comes in steps of this [rad/s of the motor shaft]; 0: in counts."""


class MotorMake(Protocol):
    """A motor with its controller in one, as it sits in its joint."""

    @property
    def motor_sign(self) -> int:
        """-1 where it turns against the joint."""

    @property
    def offset(self) -> float:
        """Position of the joint where its encoders stand at 0 [rad]."""

    def sensors(self) -> SimulatedMake:
        """Its encoders and measurements; the motor's own zero is not in them."""


PROFILE = SimulatedMake()
"""configs/romeo_left_arm/drive.eds: two encoders, current."""

LOCKING = SimulatedMake(
    link_position=key(0x6064),
    motor_position=None,
    motor_velocity=key(0x6069),
    efforts=(key(0x6077),),
    speed_limit=key(0x607F),
    link_counts=-262144,
    link_zero=52000,
    measured_velocity_unit=RPM,
    effort_unit=-0.001,
    velocity_unit=0.001 * TURN,
    acceleration_unit=TURN,
    speed_unit=0.001 * TURN,
    interpolation_s=0.004,
    locks=True,
)
"""configs/desk_arm/drive.eds: a link encoder, a tachometer, torque, and a lock after 8130."""

_BY_PRODUCT = {0x402: PROFILE, 0x403: LOCKING}


NEEDED = {
    key(0x6007): "reaction to the loss of the master",
    key(0x6040): "controlword",
    key(0x6041): "statusword",
    key(0x605A): "reaction to a quick stop",
    key(0x6060): "mode of operation",
    key(0x6085): "deceleration of a quick stop",
    key(0x60FF): "target velocity",
}
"""Objects that every simulated drive has."""


def profile_of(eds: Path) -> SimulatedMake:
    """The drive of an EDS, known by its product code (1018 sub 2). Raises ConfigurationError for
    any other, and when the EDS lacks an object that the simulation needs."""
    product = entries(eds, 1).get(key(0x1018, 2))
    number = int(product.default) if product else 0
    if number not in _BY_PRODUCT:
        known = ", ".join(f"0x{code:X}" for code in _BY_PRODUCT)
        raise ConfigurationError(
            f"{eds}: product 0x{number:X} is of no make that is known here ({known}); others are "
            "described under `drives` of simulation.yaml"
        )
    refuse_incomplete(eds, _BY_PRODUCT[number])
    return _BY_PRODUCT[number]


def refuse_incomplete(eds: Path, profile: SimulatedMake) -> None:
    """Raise ConfigurationError when an EDS lacks an object that the simulation of a make needs."""
    known = entries(eds, 1)
    needed = {
        profile.link_position: "its link position",
        profile.motor_velocity: "its motor velocity",
        profile.efforts[0]: "its current or torque",
        **NEEDED,
    }
    for where, what in needed.items():
        if where not in known:
            raise ConfigurationError(
                f"{eds}: this drive cannot be simulated: object 0x{where >> 8:04X}:"
                f"{where & 0xFF:02X} ({what}) is not in its EDS"
            )
