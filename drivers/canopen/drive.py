"""Drive of an arm: the joint that it turns, its place on the bus, its kind, its speeds."""

from dataclasses import dataclass

from drivers.canopen.settings import DriveProfile, JointWiring


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive, resolved: `profile` is what `wiring.profile` names."""

    name: str  # of the joint
    wiring: JointWiring
    profile: DriveProfile
    velocity: float  # highest commanded speed, > 0 [rad/s at the link]
    quick_stop: float  # deceleration of its quick stop, > 0 [rad/s2 at the link]
    play: float = 0.0  # of its link about its motor: width of the gap [rad]

    @property
    def node(self) -> int:
        """Its node id (CiA 301)."""
        return self.wiring.node

    def __str__(self) -> str:
        return f"node {self.node} ({self.name})"
