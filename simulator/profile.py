"""Units of the simulated drive, fixed by its maker: a wrong scale in a configuration shows here."""

from dataclasses import dataclass
from math import pi


@dataclass(frozen=True, slots=True)
class DriveProfile:
    """What one count of an object means. Motor quantities are before the gear."""

    velocity_unit: float = 0.1 * 2.0 * pi / 60.0
    """606C, 60FF [rad/s of the motor shaft] and, per second, 6085 [rad/s^2]."""
    motor_counts: int = 4096
    """6064, counts per motor revolution."""
    link_counts: int = 131072
    """60E4 sub 1, counts per link revolution (17 bit)."""
    current_unit: float = 0.001
    """6078 and 6073, share of the rated current in 6075."""
    rated_current_unit: float = 0.001
    """6075 [A]."""
    speed_unit: float = 2.0 * pi / 60.0
    """6080 [rad/s of the motor shaft]."""


PROFILE = DriveProfile()
