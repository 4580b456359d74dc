"""How far a joint still goes when the daemon has died: what its drive's patience is worth."""

from dataclasses import dataclass

from daemon.config.schema import Joint
from drivers.settings import DriveProfile


@dataclass(frozen=True, slots=True)
class Travel:
    """After the last heartbeat, at the joint's velocity limit [rad at the link]."""

    unaware: float  # until the drive misses the heartbeat
    braking: float  # while it decelerates

    @property
    def total(self) -> float:
        """Between the daemon's death and standstill, at worst."""
        return self.unaware + self.braking


def worst_travel(joint: Joint, profile: DriveProfile) -> Travel:
    """v t + v^2 / (2 a): full speed v for the drive's patience t (0x1016), then its quick stop
    with deceleration a."""
    v = joint.limits.velocity
    return Travel(
        unaware=v * profile.master_timeout_ms / 1000.0,
        braking=v * v / (2.0 * joint.limits.quick_stop),
    )
