"""Simulated makes of drives, as fixed by the manufacturer: a wrong object, scale, sign or offset in
a configuration has its real effect."""

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
    """Objects that hold a drive's quantities, and the value of one count. Motor quantities are at
    the motor shaft; objects are given by `objects.key`."""

    link_position: int = key(0x60E4, 1)
    motor_position: int | None = key(0x6064)
    motor_velocity: int = key(0x606C)
    efforts: tuple[int, ...] = (key(0x6078), key(0x6077))
    """Current or torque: as shares of the rated value they are equal."""
    speed_limit: int | None = key(0x6080)

    link_counts: int = 131072
    """Counts per link revolution (17 bit); negative if the encoder counts backwards."""
    link_zero: int = 0
    """Counts at link position 0."""
    link_at_motor: bool = False
    """True without link encoder: `link_position` is the motor's, behind the gear."""
    motor_counts: int = 4096
    """Counts per motor revolution. Negative, like the units of velocity and effort, if the motor is
    mounted the other way round."""
    measured_velocity_unit: float = 0.1 * RPM
    """Unit of `motor_velocity` [rad/s of the motor shaft]."""
    effort_unit: float = 0.001
    """Unit of `efforts`, as a share of the rated value; negative if the drive reports the opposite
    sign. Limits (6072, 6073) are per mille in every drive."""
    velocity_unit: float = 0.1 * RPM
    """Unit of 60FF [rad/s of the motor shaft]."""
    acceleration_unit: float = 0.1 * RPM
    """Unit of 6085 [rad/s^2 of the motor shaft]."""
    speed_unit: float = RPM
    """Unit of `speed_limit` [rad/s of the motor shaft]."""
    interpolation_s: float = 0.0
    """Interpolation time of a setpoint without 60C2 [s]."""
    locks: bool = False
    """True if loss of the master's heartbeat (8130) is a fault, regardless of 6007, that accepts no
    fault reset before NMT reset communication."""
    says_over: bool = False
    """True if a locked drive reports its error as over (EMCY 0) once it hears the master again, but
    stays locked; 603F keeps the code."""
    boot_s: float = 0.0
    """Time from power-up or reset to the boot-up message, without any answers."""
    sdo_delay_s: float = 0.0
    """Time from an SDO request to its answer."""
    minds_longer: bool = False
    """True if an RPDO longer than its mapping is an error (8220), as CiA 301 allows."""
    emergency_delay_s: float = 0.0
    """Time from an error to its EMCY message, as by an inhibit time (1015)."""
    hears_master: bool = True
    """True if it monitors the master's heartbeat by 1016; otherwise it continues without."""
    current_filter_ms: float | None = None
    """Filter of the reported current; None: that of the settings."""
    velocity_step: float = 0.0
    """Resolution of the measured velocity [rad/s of the motor shaft]; 0: one count."""


class MotorMake(Protocol):
    """Motor with integrated controller, as mounted in its joint."""

    @property
    def motor_sign(self) -> int:
        """Direction: -1 if it turns opposite to the joint."""

    @property
    def offset(self) -> float:
        """Joint position at which its encoders read 0 [rad]."""

    def sensors(self) -> SimulatedMake:
        """Encoders and measurements, without the motor's own zero."""


PROFILE = SimulatedMake()
"""Drive of configs/romeo_left_arm/drive.eds: two encoders, current."""

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
"""Drive of configs/desk_arm/drive.eds: link encoder, tachometer, torque, locks after 8130."""

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
"""Objects that every simulated drive must have."""


def profile_of(eds: Path) -> SimulatedMake:
    """Make of the drive of an EDS, identified by its product code (1018:2). Raises
    ConfigurationError for an unknown one, and if the EDS lacks an object that the simulation needs.
    """
    product = entries(eds, 1).get(key(0x1018, 2))
    number = int(product.default) if product else 0
    if number not in _BY_PRODUCT:
        known = ", ".join(f"0x{code:X}" for code in _BY_PRODUCT)
        raise ConfigurationError(
            f"{eds}: product 0x{number:X} is of no built-in make ({known}); describe others under "
            "`drives` of simulation.yaml"
        )
    refuse_incomplete(eds, _BY_PRODUCT[number])
    return _BY_PRODUCT[number]


def refuse_incomplete(eds: Path, profile: SimulatedMake) -> None:
    """Raise ConfigurationError if an EDS lacks an object that the simulation of a make needs."""
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
